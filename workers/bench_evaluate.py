"""How long one evaluation of P_k takes, where the time goes, and how it compares with SciPy's integrator.

All times are CPU times of this thread.  Every kernel runs once before it is timed, so that nothing is
compiled meanwhile.  The points are uniform references, the same for all k, and their realizations fly the
reference's controls.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.dynamics import STATE, THRUST
from core.problem import Problem
from core.search.mapping import onto_realizations
from core.transcription import Transcription, transcribe
from workers.bench_reference import fly_with_scipy
from workers.bench_work import Flight, ephemeris_nanoseconds, flight

Array = NDArray[np.float64]

#: Outages of the cases (segment of 50): the paper's for k = 3, every fourth segment for k = 12.
OUTAGES = {0: (), 1: (12,), 3: (12, 24, 40), 12: tuple(range(4, 49, 4))}
#: Their duration [days].
DURATION_DAYS = 1.0
#: Points that SciPy flies: it takes a hundred times as long.
SCIPY_POINTS = 3


@dataclass(frozen=True, slots=True)
class EvaluateTimes:
    """Medians over the points, of the least time of each [ms of CPU]."""

    k: int
    n_segments: int
    #: Defects alone; with the sparse Jacobian; the Hessian of weighted defects.
    defects_ms: float
    jacobian_ms: float
    hessian_ms: float
    #: What of the Jacobian goes into body positions, into the rest of the propagation, into the assembly.
    ephemeris_ms: float
    propagation_ms: float
    assembly_ms: float
    #: Sum of `jacobian_ms` over the points, over that of P_0 of the same N.
    cost_over_p0: float
    #: Median of the accepted steps.
    steps: float
    #: SciPy's time for the arcs of the same points over ours with Jacobian; None where it was not run.
    scipy_over_ours: float | None


def bench_evaluate(
    problem: Problem, rng_seed: int, n_points: int = 20, repeats: int = 7
) -> list[EvaluateTimes]:
    """Return the times for k = 0, 1, 3, 12 and N = 50, 100."""
    found = []
    for n_segments in (50, 100):
        alone = np.nan
        for k, outages in OUTAGES.items():
            listed = [(segment * n_segments // 50, DURATION_DAYS) for segment in outages]
            case = problem.model_copy(update={"n_segments": n_segments}).with_outages(listed)
            row, total = _times(transcribe(case), k, rng_seed, n_points, repeats, alone)
            alone = total if k == 0 else alone
            found.append(row)
    return found


def _times(
    transcription: Transcription, k: int, rng_seed: int, n_points: int, repeats: int, alone: float
) -> tuple[EvaluateTimes, float]:
    plan = transcription.lifted
    multipliers = np.random.default_rng(rng_seed).standard_normal(7 * len(plan.plan.block_plus))
    points = [transcription.lift(x) for x in _guesses(transcription, rng_seed, n_points)]

    works: tuple[Callable[[Array], object], ...] = (
        lambda z: transcription.evaluate(plan, z, with_partials=False),
        lambda z: transcription.evaluate(plan, z, with_partials=True),
        lambda z: transcription.hessian(plan, z, multipliers),
        lambda z: flight(transcription, z, THRUST),
    )
    defects, jacobian, hessian, flown = np.array([_least(works, z, repeats) for z in points]).T
    flights = [flight(transcription, z, STATE) for z in points]
    steps = np.array([one.steps for one in flights])
    calls = np.array([one.ephemeris_calls for one in flights])
    ephemeris = calls * ephemeris_nanoseconds(transcription) * 1e-6
    ratio = _scipy_ratio(transcription, flights, jacobian) if k == 0 else None
    parts = {
        "defects_ms": defects,
        "jacobian_ms": jacobian,
        "hessian_ms": hessian,
        "ephemeris_ms": ephemeris,
        "propagation_ms": flown - ephemeris,
        "assembly_ms": jacobian - flown,
    }
    cost = jacobian.sum() / (jacobian.sum() if k == 0 else alone)
    row = EvaluateTimes(
        k=k,
        n_segments=transcription.problem.n_segments,
        **{name: float(np.median(part)) for name, part in parts.items()},
        cost_over_p0=float(cost),
        steps=float(np.median(steps)),
        scipy_over_ours=ratio,
    )
    return row, float(jacobian.sum())


def _guesses(transcription: Transcription, rng_seed: int, n_points: int) -> list[Array]:
    """Return uniform references which all realizations follow."""
    rng = np.random.default_rng(rng_seed)
    lower, upper = transcription.bounds
    n = transcription.layout.reference.stop
    draws = lower[:n] + (upper[:n] - lower[:n]) * rng.random((n_points, n))
    return [onto_realizations(transcription, reference) for reference in draws]


def _scipy_ratio(transcription: Transcription, flights: list[Flight], ours: Array) -> float:
    fly_with_scipy(transcription, flights[0])
    ratios = []
    for one, own in list(zip(flights, ours, strict=True))[:SCIPY_POINTS]:
        begin = time.thread_time()
        fly_with_scipy(transcription, one)
        ratios.append(1e3 * (time.thread_time() - begin) / own)
    return float(np.median(ratios))


def _least(works: Sequence[Callable[[Array], object]], z: Array, repeats: int) -> list[float]:
    """Return the least CPU time of each work over some rounds [ms]; a round before them does not count."""
    spent = [[_spent(work, z) for work in works] for _ in range(repeats + 1)]
    return [1e3 * min(times[1:]) for times in zip(*spent, strict=True)]


def _spent(work: Callable[[Array], object], z: Array) -> float:
    begin = time.thread_time()
    work(z)
    return time.thread_time() - begin
