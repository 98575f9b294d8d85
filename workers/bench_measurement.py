"""One measured solve: what it cost, how it ended, and whether its result is strict and locally optimal."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from core.analysis.stationarity import OPTIMAL, stationarity
from core.problem import Problem
from core.transcription import Transcription, transcribe
from workers.job import JobOutcome, SolveRecord

#: Failures whose defects the solver calls closed and the verifier does not.
NOT_VERIFIED = "closed but not verified"


@dataclass(frozen=True, slots=True)
class Measurement:
    """One solve; CPU times are those of its thread."""

    #: Name of the `core.nlp.ExitStatus`, or how the job ended that never came to one.
    status: str
    #: Whether the solver calls its result feasible; verified at the paper's and at the strict tolerance.
    is_closed: bool = False
    paper: bool = False
    strict: bool = False
    #: Propellant of the reference, also of a result that does not close [kg].
    propellant_kg: float | None = None
    #: Largest projected component of the Lagrangian's gradient, where strict [MU per canonical unit].
    stationarity: float | None = None
    n_iterations: int = 0
    n_evaluations: int = 0
    cpu_seconds: float = 0.0
    verify_seconds: float = 0.0
    #: Last line of what went wrong in our code, empty otherwise.
    fault: str = ""

    @property
    def is_optimal(self) -> bool:
        """Whether it is strict and locally optimal."""
        return self.stationarity is not None and self.stationarity <= OPTIMAL

    @property
    def failure(self) -> str:
        """Why it is no strict solution; empty if it is one."""
        if self.strict:
            return ""
        return NOT_VERIFIED if self.is_closed else self.status


def measured(problem: Problem, outcome: JobOutcome) -> tuple[Measurement, tuple[float, ...] | None]:
    """Return what a job of one solve measured, and its decision vector if that is strict."""
    if not outcome.solves:
        fault = (outcome.error or "no solve was recorded").strip().splitlines()[-1]
        return Measurement(status=outcome.ending.name, fault=fault), None
    solve = outcome.solves[0]
    verdict = solve.certificate
    strict = verdict is not None and verdict.strict
    found = Measurement(
        status=solve.status,
        is_closed=solve.is_feasible,
        paper=verdict is not None and verdict.paper,
        strict=strict,
        propellant_kg=_propellant(problem, solve),
        stationarity=_stationarity(problem, solve) if strict else None,
        n_iterations=solve.n_iterations,
        n_evaluations=solve.n_evaluations,
        cpu_seconds=solve.cpu_seconds,
        verify_seconds=verdict.cpu_seconds if verdict else 0.0,
    )
    return found, solve.x if strict else None


def _propellant(problem: Problem, solve: SolveRecord) -> float | None:
    return None if solve.objective_kg is None else _transcribed(problem).start_mass_kg - solve.objective_kg


def _stationarity(problem: Problem, solve: SolveRecord) -> float | None:
    residual = stationarity(_transcribed(problem), np.array(solve.x)).residual
    return residual if np.isfinite(residual) else None


@lru_cache(maxsize=64)
def _transcribed(problem: Problem) -> Transcription:
    return transcribe(problem)
