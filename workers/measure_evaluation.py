"""How long one evaluation of P_k takes, where the time goes, and how it compares with SciPy's integrator.

All times are CPU times of this thread.  Every kernel runs once before it is timed, so that nothing is
compiled meanwhile.  The points are uniform references, the same for all k, and their realizations fly the
reference's controls.  Timed apart are the propagation without its assembly, the positions of the bodies, and
the same arcs by SciPy's DOP853 with the variational equations, whose right-hand side is compiled too.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from core.dynamics import STATE, THRUST, ForceModel, no_trail
from core.dynamics.force import FIELD_WIDTH, field_at, gravity, gravity_gradient
from core.ephemeris import EphemerisTable
from core.jit import compiled
from core.problem import Problem
from core.search.mapping import onto_realizations
from core.transcription import Transcription, transcribe
from core.transcription.control import thrust_of
from core.transcription.evaluate import _fly_arc, _moment, _start_state
from core.transcription.plan import Plan

Array = NDArray[np.float64]
_CALLS = 20000


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """All arcs of a plan at one point."""

    #: (n_arcs, 7) states at which they begin [LU, VU, MU].
    starts: Array
    #: (n_arcs, 2) when they begin and end [TU past departure].
    moments: Array
    #: (n_arcs, 3) controls [-, rad, rad].
    controls: Array
    #: Accepted steps.
    steps: int

    @property
    def ephemeris_calls(self) -> int:
        """Evaluations of body positions: one at the start of an arc, twelve in an accepted step."""
        return len(self.starts) + 12 * self.steps


def flight(transcription: Transcription, z: Array, width: int) -> Flight:
    """Fly all arcs of the lifted form with that many columns."""
    plan, setting = transcription.lifted.plan, transcription.setting
    n_arcs = len(plan.arc_control)
    starts, moments = np.empty((n_arcs, 7)), np.empty((n_arcs, 2))
    steps = _fly(
        setting.model,
        setting.target,
        setting.departure,
        plan,
        z,
        transcription.tolerance,
        width,
        starts,
        moments,
    )
    free = np.where(plan.arc_control < 0, 0, plan.arc_control)
    controls = np.where(plan.arc_control[:, None] < 0, plan.arc_fixed, z[free[:, None] + np.arange(3)])
    return Flight(starts, moments, controls, steps)


@compiled
def _fly(
    model: ForceModel,
    target: EphemerisTable,
    departure: Array,
    plan: Plan,
    z: Array,
    tolerance: float,
    width: int,
    starts: Array,
    moments: Array,
) -> int:
    ends = np.zeros((plan.leg_start.shape[0], 7))
    r, v, work = np.zeros((3, width)), np.zeros((3, width)), np.zeros((16, 3, width))
    accelerations, thrust, d_thrust, d_rate = np.zeros((2, 3)), np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    transition, by_control, rates = np.zeros((7, 7)), np.zeros((7, 3)), np.zeros((2, 7))
    d_start, trail = np.zeros(7), no_trail()
    steps = 0
    for leg in range(plan.leg_start.shape[0]):
        _start_state(model, target, departure, plan, z, leg, ends, d_start)
        for arc in range(plan.leg_first[leg], plan.leg_first[leg] + plan.leg_arcs[leg]):
            starts[arc] = ends[leg]
            for end in range(2):
                moments[arc, end] = _moment(plan, arc, end, plan.leg_trajectory[leg], z)
            steps += _fly_arc(
                model, plan, z, arc, plan.leg_trajectory[leg], tolerance, ends[leg], r, v, work,
                accelerations, thrust, d_thrust, d_rate, transition, by_control, rates, trail,
            )  # fmt: skip
    return steps


def ephemeris_nanoseconds(transcription: Transcription) -> float:
    """Return the CPU time of one evaluation of the body positions [ns]."""
    field = transcription.setting.model.field
    arguments = (field.start, field.record, field.coefficients, np.empty(FIELD_WIDTH))
    spent = []
    for _ in range(6):
        begin = time.thread_time()
        _ask(*arguments)
        spent.append(time.thread_time() - begin)
    return 1e9 * min(spent) / _CALLS


@compiled
def _ask(start: float, record: float, coefficients: Array, out: Array) -> float:
    total = 0.0
    for n in range(_CALLS):
        field_at(start, record, coefficients, start + (5.0 + 1e-4 * n) * record, out)
        total += out[0]
    return total


#: Columns: by position, velocity, mass and control.
_COLUMNS = 10


def fly_with_scipy(transcription: Transcription, flight: Flight) -> Array:
    """Return state and partials (n_arcs, 7 + 60) at the ends of all arcs [canonical]."""
    model, tolerance = transcription.setting.model, transcription.tolerance
    flow = model.max_thrust / model.exhaust_velocity
    out = np.empty((len(flight.starts), 7 + 6 * _COLUMNS))
    for n, (start, span, control) in enumerate(
        zip(flight.starts, flight.moments, flight.controls, strict=True)
    ):
        thrust, d_thrust = np.empty(3), np.empty((3, 3))
        thrust_of(control, model.max_thrust, thrust, d_thrust)
        field = model.field
        push = (span[0], thrust, control[0] * flow, d_thrust, flow)
        table = (field.start, field.record, field.coefficients)
        y = np.concatenate([start, np.eye(6, _COLUMNS).ravel()])
        arc = solve_ivp(
            _rates, span, y, method="DOP853", rtol=tolerance, atol=tolerance, args=(model.gm, *table, *push)
        )
        out[n] = arc.y[:, -1]
    return out


@compiled
def _rates(
    t: float, y: Array, gm: Array, start: float, record: float, coefficients: Array,
    t_a: float, thrust: Array, mass_rate: float, d_thrust: Array, flow: float,
) -> Array:  # fmt: skip
    """Return the derivative of state and partials, docs/method.md eqs. 2-5."""
    field, out = np.empty(FIELD_WIDTH), np.empty(y.size)
    field_at(start, record, coefficients, t, field)
    a = gravity(gm, field, y[0], y[1], y[2])
    xx, xy, xz, yy, yz, zz = gravity_gradient(gm, field, y[0], y[1], y[2])
    inverse = 1.0 / y[6]
    for i in range(3):
        out[i], out[3 + i] = y[3 + i], a[i] + thrust[i] * inverse
    out[6] = -mass_rate
    columns, rates = y[7:].reshape(6, _COLUMNS), out[7:].reshape(6, _COLUMNS)
    rates[:3] = columns[3:]
    for q in range(_COLUMNS):
        r0, r1, r2 = columns[0, q], columns[1, q], columns[2, q]
        rates[3, q] = xx * r0 + xy * r1 + xz * r2
        rates[4, q] = xy * r0 + yy * r1 + yz * r2
        rates[5, q] = xz * r0 + yz * r1 + zz * r2
    for i in range(3):
        rates[3 + i, 6] -= thrust[i] * inverse * inverse
        for j in range(3):
            rates[3 + i, 7 + j] += d_thrust[j, i] * inverse
        # Only the throttle changes the mass.
        rates[3 + i, 7] += thrust[i] * inverse * inverse * flow * (t - t_a)
    return out


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
