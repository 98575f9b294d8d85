"""Settings, outcome and remaining budget of a solve.

Limits are iterations, CPU time, and a caller who may ask it to stop.
"""

import resource
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class ExitStatus(Enum):
    """How a solve ended; the value is the sentence shown to the user."""

    OPTIMAL = "All defects and bounds hold, and the propellant is a local minimum to tolerance."
    ACCEPTABLE = "All defects and bounds hold; the propellant settled short of the optimality tolerance."
    FEASIBLE_AT_LIMIT = (
        "All defects and bounds hold, but a limit came before the optimum; allow more iterations."
    )
    FEASIBLE_AT_DEADLINE = "All defects and bounds hold, but the CPU deadline came first; raise cpu_seconds."
    ITERATION_LIMIT = (
        "The iteration limit came before the defects closed; raise max_iterations or start from a seed."
    )
    TIMEOUT = "The CPU deadline came before the defects closed; raise cpu_seconds or start from a seed."
    STOPPED = "The solve was asked to stop; nothing is wrong with the guess."
    LOCALLY_INFEASIBLE = "The solver settled where defects remain; hop again, or shorten the outage."
    STALLED = "Defects remain, or the path magnifies rounding into some; hop again, or start from a seed."
    IMPACT = "The path found leads lower over a body than it may; hop again, or start from a seed."
    NOT_FINITE = "A state or a partial was not finite; check for a passage through a body."
    SOLVER_FAILURE = "The solver gave up for a reason of its own; hop again."


#: What is wanted of the realizations.
RECOVERIES = (CHEAPEST, ANY) = ("cheapest", "any")


@dataclass(frozen=True, slots=True)
class SolveSettings:
    """Limits of one solve; both are multiplied by 1 + k, so that P_k has k + 1 times the budget of P_0."""

    #: CPU time after which the solve ends [s]: a safeguard; normally iterations are the limit.
    cpu_seconds: float = 120.0
    #: Iterations of the solver, all phases together [-].
    max_iterations: int = 3000
    #: A name of `RECOVERIES`: the cheapest found for the reference, or as they close, which is the paper's.
    recoveries: str = ANY

    def __post_init__(self) -> None:
        """Raise ValueError for limits under which nothing can be solved."""
        is_number = isinstance(self.cpu_seconds, int | float) and not isinstance(self.cpu_seconds, bool)
        if not (is_number and np.isfinite(self.cpu_seconds) and self.cpu_seconds > 0):
            raise ValueError(f"cpu_seconds: expected a positive number, got {self.cpu_seconds!r}")
        is_count = isinstance(self.max_iterations, int) and not isinstance(self.max_iterations, bool)
        if not is_count or self.max_iterations < 1:
            raise ValueError(
                f"max_iterations: expected an integer of at least 1, got {self.max_iterations!r}"
            )
        if self.recoveries not in RECOVERIES:
            raise ValueError(f"recoveries: expected one of {', '.join(RECOVERIES)}, got {self.recoveries!r}")


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What a solve returns, feasible or not."""

    status: ExitStatus
    #: (n_variables,) best decision vector found: the best feasible one, else the least infeasible.
    x: Array
    #: Final mass of the reference [kg]; more is better.
    objective: float
    #: Largest defect over its strict tolerance [-]; at most 1 where x is feasible.
    violation: float
    #: (1 + k, 7) defects of x [km, km/s, kg].
    defects: Array
    n_iterations: int
    #: Evaluations of the defects, with or without partials.
    n_evaluations: int
    cpu_seconds: float

    @property
    def is_feasible(self) -> bool:
        """Whether every defect holds to the strict tolerance, as solved; `core.verification` decides."""
        return self.violation <= 1.0


Stop = Callable[[], bool]

# RUSAGE_THREAD counts the solving thread alone; only Linux has it.
_WHO = getattr(resource, "RUSAGE_THREAD", resource.RUSAGE_SELF)


def cpu_seconds() -> float:
    """Return the CPU time used so far [s], which is no time of day."""
    usage = resource.getrusage(_WHO)
    return usage.ru_utime + usage.ru_stime


@dataclass(slots=True)
class Limits:
    """The budget of one solve, shared by its phases."""

    cpu_budget: float
    iteration_budget: int
    stop: Stop
    started: float = field(default_factory=cpu_seconds)
    iterations: int = 0
    #: Whether the caller has requested a stop, at least once.
    is_stopped: bool = False
    evaluations: int = 0

    @property
    def cpu_used(self) -> float:
        """CPU time since the solve began [s]."""
        return cpu_seconds() - self.started

    @property
    def is_late(self) -> bool:
        """Whether the CPU deadline has passed."""
        return self.cpu_used > self.cpu_budget

    @property
    def is_over(self) -> bool:
        """Whether any limit was reached."""
        self.is_stopped = self.is_stopped or self.stop()
        return self.is_stopped or self.iterations >= self.iteration_budget or self.is_late
