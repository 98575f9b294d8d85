"""How often, how fast and how well guesses of one problem are solved: what `coastarc bench solve` measures.

Jobs are of one solve each, as campaigns run them, on one process or on two, so what is measured is what a
campaign pays: `core.solve` or `core.solve_seed` inside `run_job`, by the processor time of its thread.
Verification is timed apart.  Compilation and tables are made in a first job of every process, which counts
nothing.  A set of measured solves is summed up as shares with intervals, costs, distributions and failures;
its solutions can be saved, and are the seeds of `coastarc bench chain`.
"""

import json
import math
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from core.analysis.metrics import feasibility_ratio
from core.analysis.similarity import DISTINCT, clusters, distance, feature_rows
from core.analysis.stationarity import OPTIMAL, stationarity
from core.jit import COMPILED_FOLDER
from core.nlp import ExitStatus, SolveSettings, solve
from core.plain_data import read_text
from core.problem import Problem, problem_from
from core.search import GUESS_LAWS, Chain, HopSettings, hop_rng
from core.transcription import DEFAULT_LEGS, Transcription, checked_vector, layout_of, transcribe
from workers.executor import Executor
from workers.messages import Address, HopJob, Job, JobOutcome, JobSettings, MapJob, SolveRecord, Ticket
from workers.run import hop_address

__all__ = [
    "DISTINCT",
    "Solution",
    "distance",
    "distinct",
    "read_solutions",
    "write_json",
    "write_solutions",
]


#: Iterations of a first job: enough to pass through what a solve calls.
WARMING_ITERATIONS = 12
#: How long to wait for news before looking at the keyboard again [s].
PATIENCE_S = 0.5
# Uncounted jobs have tickets below zero.
_WARMING = -1


def guess_job(problem: Problem, number: int, rng_seed: int, law: str, limits: SolveSettings) -> HopJob:
    """Return the solve of one guess; its address alone fixes its numbers, so any worker draws the same."""
    return HopJob(
        problem=problem.model_dump(mode="json"),
        rng_seed=rng_seed,
        address=Address(search=0, chain=number),
        n_hops=1,
        laws=HopSettings(guess_law=law),
        settings=_settings(limits),
    )


def seed_job(
    problem: Problem,
    seed_problem: Problem,
    x: tuple[float, ...],
    mapping: str,
    number: int,
    limits: SolveSettings,
) -> MapJob:
    """Return the solve of one seed."""
    return MapJob(
        problem=problem.model_dump(mode="json"),
        rng_seed=0,
        address=Address(search=0, chain=number),
        seed_id=str(number),
        seed_problem=seed_problem.model_dump(mode="json"),
        seed_x=x,
        mapping=mapping,
        settings=_settings(limits),
    )


def _settings(limits: SolveSettings) -> JobSettings:
    return JobSettings(
        cpu_seconds=limits.cpu_seconds, max_iterations=limits.max_iterations, n_legs=DEFAULT_LEGS
    )


def warm(executor: Executor, jobs: Iterable[Job]) -> None:
    """Run jobs with few iterations on every process, so that compilation is not timed."""
    for job in jobs:
        brief = job.settings.model_copy(update={"max_iterations": WARMING_ITERATIONS})
        brief_job = job.model_copy(update={"settings": brief})
        for place in range(executor.capacity()):
            executor.submit(Ticket(_WARMING - place, 1), brief_job)
        left = executor.capacity()
        while left:
            left -= len(executor.finished(PATIENCE_S))


def outcomes(executor: Executor, jobs: Iterable[tuple[int, Job]]) -> Iterator[tuple[int, JobOutcome]]:
    """Yield the outcome of every numbered job as it ends; numbers must differ."""
    waiting = iter(jobs)
    running, is_drained = 0, False
    while running or not is_drained:
        while running < executor.capacity() and not is_drained:
            numbered = next(waiting, None)
            if numbered is None:
                is_drained = True
            else:
                executor.submit(Ticket(numbered[0], 1), numbered[1])
                running += 1
        for finished in executor.finished(PATIENCE_S) if running else ():
            running -= 1
            yield finished.ticket.job_id, JobOutcome.model_validate_json(finished.outcome.to_json())


def n_compiled_kernels() -> int:
    """Return how many compiled kernels the disk holds for this code: more after a run, if it compiled."""
    return sum(1 for _ in COMPILED_FOLDER.rglob("*.nbc"))


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
    #: Largest defects of a trajectory as solved; None without a solve, or where one is not finite.
    defect_km: float | None = None
    defect_m_s: float | None = None

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
        defect_km=_largest(solve, slice(0, 3), 1.0),
        defect_m_s=_largest(solve, slice(3, 6), 1e3),
    )
    return found, solve.x if strict else None


def _largest(solve: SolveRecord, part: slice, scale: float) -> float | None:
    """Return the largest norm of a part of the defects, in units of which one km or km/s has so many."""
    rows = [row[part] for row in solve.defects]
    if any(value is None for row in rows for value in row):
        return None
    return scale * max(math.hypot(*(value or 0.0 for value in row)) for row in rows)


def _propellant(problem: Problem, solve: SolveRecord) -> float | None:
    return None if solve.objective_kg is None else _transcription(problem).start_mass_kg - solve.objective_kg


def _stationarity(problem: Problem, solve: SolveRecord) -> float | None:
    residual = stationarity(_transcription(problem), np.array(solve.x)).residual
    return residual if np.isfinite(residual) else None


@lru_cache(maxsize=64)
def _transcription(problem: Problem) -> Transcription:
    return transcribe(problem)


@dataclass(frozen=True, slots=True)
class Solution:
    """A strict solution and its problem."""

    #: Its number in the run that found it.
    number: int
    problem: Problem
    #: In the paper layout [days, rad, kg].
    x: tuple[float, ...]
    #: Propellant of the reference [kg].
    propellant_kg: float
    is_optimal: bool


def write_json(path: Path, content: Any) -> None:
    """Replace a file atomically."""
    beside = path.with_name(path.name + ".new")
    beside.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    os.replace(beside, path)


def write_solutions(path: Path, problem: Problem, solutions: Iterable[Solution]) -> None:
    """Save solutions of problems of one family."""
    listed = [
        {
            "number": one.number,
            "outages": [[outage.segment, outage.duration_days] for outage in one.problem.outages],
            "propellant_kg": one.propellant_kg,
            "is_optimal": one.is_optimal,
            "x": one.x,
        }
        for one in solutions
    ]
    without = problem.model_copy(update={"outages": ()})
    write_json(path, {"problem": without.model_dump(mode="json"), "solutions": listed})


def read_solutions(path: Path) -> list[Solution]:
    """Return saved solutions, or raise ValueError naming the file, what was expected and what came."""
    try:
        content = json.loads(read_text(path))
        problem = problem_from(content["problem"])
        return [_solution(problem, entry) for entry in content["solutions"]]
    except OSError as error:
        raise ValueError(f"seeds: expected a file that can be read, got {path}: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        told = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise ValueError(f"seeds: expected what `bench solve --save` writes, got {path}: {told}") from error


def _solution(problem: Problem, entry: dict[str, Any]) -> Solution:
    case = problem.with_outages([(segment, days) for segment, days in entry["outages"]])
    x = tuple(checked_vector(layout_of(case), entry["x"]).tolist())
    return Solution(int(entry["number"]), case, x, float(entry["propellant_kg"]), bool(entry["is_optimal"]))


def distinct(solutions: Iterable[Solution]) -> list[Solution]:
    """Return the solutions of one family that are farther than `DISTINCT` from every one kept before them."""
    listed = list(solutions)
    if not listed:
        return []
    found = clusters(feature_rows(listed[0].problem, [np.asarray(one.x) for one in listed]), DISTINCT)
    return [listed[i] for i in np.unique(found, return_index=True)[1]]


@dataclass(frozen=True, slots=True)
class GuessPlan:
    """The guesses of one problem that are to be solved."""

    problem: Problem
    n_guesses: int
    rng_seed: int = 1
    law: str = "uniform"
    limits: SolveSettings = field(default_factory=SolveSettings)

    def __post_init__(self) -> None:
        if self.n_guesses < 1:
            raise ValueError(f"guesses: expected at least 1, got {self.n_guesses}")
        if self.law not in GUESS_LAWS:
            raise ValueError(f"law: expected one of {', '.join(GUESS_LAWS)}, got {self.law!r}")


@dataclass(frozen=True, slots=True)
class SolvedGuess:
    """One guess by its number, from 0, and what its solve measured."""

    number: int
    measurement: Measurement
    #: The decision vector of a strict solution [days, rad, kg].
    x: tuple[float, ...] | None


def warm_up(executor: Executor, plan: GuessPlan) -> None:
    """Let every process compile and load all that it needs, before anything is timed."""
    warm(executor, [_job(plan, 0)])


def solve_guesses(executor: Executor, plan: GuessPlan) -> Iterator[SolvedGuess]:
    """Solve guesses one by one and yield each as it ends; with several processes not always in order."""
    numbered = ((number, _job(plan, number)) for number in range(plan.n_guesses))
    for number, outcome in outcomes(executor, numbered):
        yield SolvedGuess(number, *measured(plan.problem, outcome))


#: Throttles beyond this share of their bound count as full [-], since the descent stays somewhat below it;
#: variables so near to a bound count as at it.
_FULL, _AT_BOUND = 0.95, 1e-3
#: Failures of one kind that are solved once more to see which bounds hold them back.
_EXAMPLES = 2


@dataclass(frozen=True, slots=True)
class FailureView:
    """Guesses that failed in one way, and what is known of why."""

    failure: str
    n: int
    #: The status's sentence, or what went wrong in our code.
    reason: str
    #: Medians of their largest defects; None where none is finite.
    defect_km: float | None
    defect_m_s: float | None
    #: Fields of the problem whose bounds were active in each of the examples, with the share of segments at
    #: full thrust.
    at_bounds: list[str]


def failures_of(plan: GuessPlan, solved: Sequence[SolvedGuess]) -> list[FailureView]:
    """Return why guesses failed, the most frequent failure first; some are solved once more for that."""
    kinds: dict[str, list[SolvedGuess]] = {}
    for one in sorted(solved, key=lambda one: one.number):
        if not one.measurement.strict:
            kinds.setdefault(one.measurement.failure, []).append(one)
    ordered = sorted(kinds.items(), key=lambda kind: -len(kind[1]))
    return [_failure_of(plan, name, some) for name, some in ordered]


def _failure_of(plan: GuessPlan, name: str, some: Sequence[SolvedGuess]) -> FailureView:
    found = [one.measurement for one in some]
    status = ExitStatus.__members__.get(name)
    told = status.value if status else "The verifier finds larger defects than the solver."
    active = [_at_bounds(plan, one.number) for one in some[:_EXAMPLES]] if status else []
    position, velocity = (spread(getattr(one, part) for one in found) for part in ("defect_km", "defect_m_s"))
    return FailureView(
        failure=name,
        n=len(some),
        reason=found[0].fault or told,
        defect_km=position["median"] if position else None,
        defect_m_s=velocity["median"] if velocity else None,
        at_bounds=[field for field in (active[0] if active else []) if all(field in one for one in active)],
    )


def _at_bounds(plan: GuessPlan, number: int) -> list[str]:
    """Return the fields whose bounds are active where the solve of a guess ends."""
    transcription, job = _transcription(plan.problem), _job(plan, number)
    guess = Chain(transcription, job.laws).ask(hop_rng(job.rng_seed, hop_address(job, 0)))
    x = solve(transcription, guess, plan.limits).x
    lower, upper = transcription.bounds
    own, near = transcription.layout.reference, _AT_BOUND * (upper - lower)
    named = {
        "shooting_days": own.shooting_time,
        "initial_coast_days": own.initial_coast,
        "final_coast_days": own.final_coast,
    }
    sides = (("[0]", x - lower), ("[1]", upper - x))
    found = [
        f"bounds.{field}{side}"
        for field, place in named.items()
        for side, room in sides
        if place not in transcription.idle_coasts and room[place] <= near[place]
    ]
    if x[own.final_mass] - lower[own.final_mass] <= near[own.final_mass]:
        found.append("bounds.min_final_mass_kg")
    full = float(np.mean(x[own.controls][::3] >= _FULL * plan.problem.bounds.throttle[1]))
    return [*found, "spacecraft.max_thrust_n"] if full > 0.5 else found


def solution_of(plan: GuessPlan, one: SolvedGuess) -> Solution:
    """Return a strict solution under the number of its guess."""
    assert one.x is not None and one.measurement.propellant_kg is not None
    found = one.measurement
    return Solution(one.number, plan.problem, one.x, one.measurement.propellant_kg, found.is_optimal)


def load_seeds(
    executor: Executor, plan: GuessPlan, n: int, tell: Callable[[str], None] = lambda line: None
) -> list[Solution]:
    """Return the first n distinct solutions in the order of the guesses, whatever the number of processes."""
    warm_up(executor, plan)
    solved: dict[int, SolvedGuess] = {}
    kept: list[Solution] = []
    for one in solve_guesses(executor, plan):
        solved[one.number] = one
        # Up to the first guess that is still being solved, so that a slower one is not passed over.
        is_known = [number in solved for number in range(plan.n_guesses)]
        ready = is_known.index(False) if False in is_known else plan.n_guesses
        known = (solved[number] for number in range(ready))
        kept = distinct(solution_of(plan, guess) for guess in known if guess.x is not None)
        tell(f"{len(solved)} guesses: {len(kept)} of {n} seeds")
        if len(kept) >= n:
            return kept[:n]
    raise ValueError(f"seeds: expected {n} distinct solutions, got {len(kept)} of {plan.n_guesses} guesses")


def _job(plan: GuessPlan, number: int) -> HopJob:
    return guess_job(plan.problem, number, plan.rng_seed, plan.law, plan.limits)


#: The statistics that describe a distribution.
QUANTILES = {"min": 0.0, "q1": 0.25, "median": 0.5, "q3": 0.75, "max": 1.0}


def share(n_successes: int, n: int) -> dict[str, float | int | None]:
    """Return a share with its 95 % Wilson interval; its value is null for n = 0."""
    value, low, high = feasibility_ratio(n_successes, n)
    return {"n": n_successes, "of": n, "value": value if n else None, "low": low, "high": high}


def spread(values: Iterable[float | None]) -> dict[str, float] | None:
    """Return least, quartiles and greatest of the values that are known; null if none is."""
    known = [value for value in values if value is not None]
    if not known:
        return None
    return dict(zip(QUANTILES, np.quantile(known, list(QUANTILES.values())).tolist(), strict=True))


def costs(found: Sequence[Measurement]) -> dict[str, float | None]:
    """Return CPU times [s]; those per solution charge the failures too, and are null without solutions."""
    spent = sum(one.cpu_seconds for one in found)
    n_strict, n_optimal = (sum(flags) for flags in ([m.strict for m in found], [m.is_optimal for m in found]))
    return {
        "cpu_seconds": spent,
        "verify_seconds": sum(one.verify_seconds for one in found),
        "cpu_seconds_per_strict": spent / n_strict if n_strict else None,
        "cpu_seconds_per_optimal": spent / n_optimal if n_optimal else None,
    }


def failures(found: Sequence[Measurement]) -> dict[str, int]:
    """Return how often each failure came, the most frequent first."""
    return dict(Counter(one.failure for one in found if not one.strict).most_common())


def summary(found: Sequence[Measurement]) -> dict[str, Any]:
    """Return all that `bench solve` says about its guesses, as plain data."""
    solved, failed = [m for m in found if m.strict], [m for m in found if not m.strict]
    propellant = spread(one.propellant_kg for one in solved)
    return {
        "paper": share(sum(one.paper for one in found), len(found)),
        "strict": share(len(solved), len(found)),
        "optimal": share(sum(one.is_optimal for one in found), len(found)),
        "costs": costs(found),
        "best_propellant_kg": propellant["min"] if propellant else None,
        "median_propellant_kg": propellant["median"] if propellant else None,
        "stationarity": spread(one.stationarity for one in solved),
        "successes": _distributions(solved),
        # What they burnt says nothing, since they do not arrive.
        "failures": _distributions(failed) | {"propellant_kg": None},
        "failed_by": failures(found),
        "ended_by": dict(Counter(one.status for one in found).most_common()),
        "faults": sorted({one.fault for one in found if one.fault}),
    }


def _distributions(found: Sequence[Measurement]) -> dict[str, Any]:
    return {
        "cpu_seconds": spread(one.cpu_seconds for one in found),
        "iterations": spread(one.n_iterations for one in found),
        "propellant_kg": spread(one.propellant_kg for one in found),
    }


@dataclass(frozen=True, slots=True, order=True)
class Case:
    """S(k|k') at given outages, as `S(3|0)@12-24-40`."""

    #: Number k' of outages of its seeds.
    k_from: int
    #: Segments at whose start the k outages begin.
    segments: tuple[int, ...]

    @property
    def k(self) -> int:
        """Number of outages."""
        return len(self.segments)

    @property
    def group(self) -> str:
        """The strategy."""
        return f"S({self.k}|{self.k_from})"

    @property
    def name(self) -> str:
        """Strategy and outages."""
        return f"{self.group}@{'-'.join(map(str, self.segments))}"

    def problem(self, reference: Problem, duration_days: float) -> Problem:
        """Return P_k; all outages last equally long."""
        return reference.with_outages([(segment, duration_days) for segment in self.segments])

    def is_fed_by(self, other: "Case") -> bool:
        """Return whether solutions of the other case are seeds of this one."""
        return other.k == self.k_from and set(other.segments) < set(self.segments)


def _cases(k_from: int, *outages: tuple[int, ...]) -> tuple[Case, ...]:
    return tuple(Case(k_from, segments) for segments in outages)


# The outages of the paper's tables of P_1, and of P_2 and P_3.
_P1 = tuple((segment,) for segment in (4, 8, 12, 16, 20, 24, 26, 32, 40, 48))
_P2 = ((4, 48), (12, 40), (20, 32), (4, 12), (8, 16), (12, 20))
_P3 = ((4, 24, 48), (4, 26, 48), (12, 24, 40), (12, 26, 40), (4, 8, 12), (4, 12, 20))
_P3_FROM_2 = _cases(2, *_P3)

#: Groups of cases by name; `s3from2` brings along the cases of P_2 that feed it.
GROUPS: dict[str, tuple[Case, ...]] = {
    "s1": _cases(0, *_P1),
    "s2": _cases(0, *_P2),
    "s3": _cases(0, *_P3),
    "s3from2": tuple(c for c in _cases(0, *_P2) if any(t.is_fed_by(c) for t in _P3_FROM_2)) + _P3_FROM_2,
    "s12": _cases(0, tuple(range(4, 49, 4))),
    "s49": _cases(0, tuple(range(1, 50))),
}

#: What runs unless something else is asked for.
DEFAULT_GROUPS = ("s1", "s2", "s3", "s3from2", "s12")


def parse_cases(text: str) -> list[Case]:
    """Return the cases of a list like `S(1|0)@24,S(3|0)@12-24-40`."""
    return [_parse_case(part.strip()) for part in text.split(",")]


def group_cases(text: str) -> list[Case]:
    """Return the cases of named groups, as `s1,s12`."""
    found: list[Case] = []
    for name in (part.strip() for part in text.split(",")):
        if name not in GROUPS:
            raise ValueError(f"group: expected one of {', '.join(GROUPS)}, got {name!r}")
        found += GROUPS[name]
    return found


def in_order(cases: list[Case]) -> list[Case]:
    """Return each case once, those that feed others first, or refuse a case that nothing feeds."""
    kept = sorted(dict.fromkeys(cases), key=lambda case: case.k_from)
    for case in kept:
        if case.k_from and not any(case.is_fed_by(other) for other in kept):
            wanted = f"a case with {case.k_from} of its outages in the same run"
            raise ValueError(f"case {case.name}: expected {wanted}, which gives its seeds, got none")
    return kept


def _parse_case(text: str) -> Case:
    match = re.fullmatch(r"S\((\d+)\|(\d+)\)@(\d+(?:-\d+)*)", text)
    if match is None:
        raise ValueError(f"case: expected one like S(3|0)@12-24-40, got {text!r}")
    k, k_from = int(match[1]), int(match[2])
    segments = tuple(sorted(int(segment) for segment in match[3].split("-")))
    if len(set(segments)) != k or len(segments) != k:
        raise ValueError(f"case {text}: expected {k} different segments, got {len(segments)}: {match[3]}")
    if k_from >= k:
        raise ValueError(f"case {text}: expected seeds with fewer than {k} outages, got {k_from}")
    return Case(k_from, segments)
