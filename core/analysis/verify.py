"""The judge: every trajectory of a solution flown again by SciPy and SPICE, and its defects weighed.

What flows in: a problem and its decision vector x in public units.  What flows out: the defects
(forward minus backward) that an independent flight finds, and whether they hold at the two tolerances of
docs/method.md.  The layout of x, the segments and the outages are read here a second time on purpose:
no line is shared with `core.transcription` or `core.dynamics`, so a common mistake has nowhere to hide.
"""

import functools
import hashlib
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import NamedTuple

import numpy as np

from core.analysis.reflight import INTEGRATOR, RTOL, Array, Pilot, Unflyable
from core.constants import G0, SECONDS_PER_DAY
from core.ephemeris.kernels import check_kernels, furnish, kernel_hashes, one_at_a_time
from core.orbits import departure_state, target_kernel
from core.problem import Problem
from core.tolerances import PAPER, STRICT, Tolerance

# The planetary kernel; epochs are TDB throughout, so the leap seconds play no part.
_PLANETS = "de440.bsp"

#: Share of a bound's width by which x may pass it: IPOPT itself relaxes bounds by 1e-8.
BOUND_SLACK = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class Verification:
    """What an independent flight of one decision vector found; trajectory 0 is the reference."""

    #: Forward minus backward state at the matchpoints (1 + k, 7) [km, km/s, kg], geocentric J2000.
    defects: Array
    #: Norms of the three parts of the defects, (1 + k,) each.
    position_km: Array
    velocity_km_s: Array
    mass_kg: Array
    #: Whether defects and bounds hold at the paper's and at the strict tolerance.
    paper: bool
    strict: bool
    #: Distance from the target at insertion, after coasting back from arrival (1 + k, 2) [km, km/s].
    target_error: Array
    #: Epoch of arrival (1 + k,) [TDB s past J2000].
    arrival_et: Array
    #: Mass at arrival (1 + k,) [kg].
    final_mass_kg: Array
    is_within_bounds: bool
    #: Why a trajectory could not be flown, empty if all were.
    failure: str
    integrator: str
    #: Relative tolerance of the integrator.
    tolerance: float
    #: Kernels flown with, as (name, hash).
    kernels: tuple[tuple[str, str], ...]
    n_evaluations: int


class _Plan(NamedTuple):
    """The part of x that belongs to one trajectory; times in seconds."""

    shooting: float
    initial_coast: float
    final_coast: float
    controls: Array  # (n_segments, 3)
    final_mass: float

    @property
    def n_forward(self) -> int:
        return len(self.controls) // 2

    @property
    def segment_duration(self) -> float:
        return self.shooting / len(self.controls)


class _Flown(NamedTuple):
    """States at the starts of the segments; times in seconds past the departure epoch."""

    #: y_1 .. y_{Nf+1}, (n_forward + 1, 7).
    forward: Array
    #: z_{Nf+1} .. z_{N+1}, (n_backward + 1, 7).
    backward: Array
    #: Start of the first segment, and arrival.
    start: float
    arrival: float
    target_error: tuple[float, float]
    failure: str


@one_at_a_time
def verify(problem: Problem, x: Array) -> Verification:
    """Fly the reference and every realization of x again and weigh the defects.

    A trajectory that cannot be flown (it meets a body, or runs out of mass) has defects that are not
    finite, `strict` and `paper` are False, and `failure` says where it ended.

    Parameters
    ----------
    problem : Problem
        P_k.
    x : (n_variables,) array
        T_s, T_i, T_f [days], N times (throttle [-], in-plane, out-of-plane [rad]), m_f [kg] for the
        reference, then the same for each realization in the order of `problem.outages`.

    Returns
    -------
    Verification
        Defects [km, km/s, kg], their norms, and the verdict at both tolerances.

    Raises
    ------
    ValueError
        When x has another shape than the problem asks for, or is not finite.

    References
    ----------
    docs/method.md, "Verification".
    """
    plans = _plans(problem, x)
    check_kernels()
    kernel, naif_id = target_kernel(problem)
    furnish(kernel)
    flights, n_evaluations = _fly_all(problem, plans, naif_id)
    defects = np.array([flown.forward[-1] - flown.backward[0] for flown in flights])
    norms = _norms(defects)
    is_within_bounds = _is_within_bounds(problem, plans)
    return Verification(
        defects=defects,
        position_km=norms[:, 0],
        velocity_km_s=norms[:, 1],
        mass_kg=norms[:, 2],
        paper=is_within_bounds and holds(defects, PAPER),
        strict=is_within_bounds and holds(defects, STRICT),
        target_error=np.array([flown.target_error for flown in flights]),
        arrival_et=_departure(problem)[0] + np.array([flown.arrival for flown in flights]),
        final_mass_kg=np.array([plan.final_mass for plan in plans]),
        is_within_bounds=is_within_bounds,
        failure="; ".join(_named(flights)),
        integrator=INTEGRATOR,
        tolerance=RTOL,
        kernels=(
            (_PLANETS, kernel_hashes()[_PLANETS]),
            (kernel.name, _digest(kernel, kernel.stat().st_mtime_ns)),
        ),
        n_evaluations=n_evaluations,
    )


def holds(defects: Array, tolerance: Tolerance) -> bool:
    """Return whether defects (n, 7) [km, km/s, kg] are finite and within a tolerance, norm by norm."""
    # A comparison with NaN is False, so defects that are not finite never hold.
    limits = (tolerance.position_km, tolerance.velocity_km_s, tolerance.mass_kg)
    return bool(np.all(_norms(defects) <= np.array(limits)))


def _norms(defects: Array) -> Array:
    position = np.linalg.norm(defects[:, 0:3], axis=1)
    velocity = np.linalg.norm(defects[:, 3:6], axis=1)
    return np.stack([position, velocity, np.abs(defects[:, 6])], axis=1)


def _segment_counts(problem: Problem) -> list[int]:
    n = problem.n_segments
    adaptive = problem.segmentation == "adaptive"
    return [n, *(n - outage.segment if adaptive else n for outage in problem.outages)]


def _plans(problem: Problem, x: Array) -> list[_Plan]:
    counts = _segment_counts(problem)
    expected = sum(3 * count + 4 for count in counts)
    x = np.asarray(x, dtype=np.float64)
    if x.shape != (expected,):
        case = f"{problem.n_segments} segments and {problem.k} outages"
        raise ValueError(f"decision vector: expected shape ({expected},) for {case}, got {x.shape}")
    if not np.all(np.isfinite(x)):
        first = int(np.flatnonzero(~np.isfinite(x))[0])
        raise ValueError(f"decision vector: expected finite numbers, got {x[first]} at index {first}")
    plans = []
    for count in counts:
        own, x = np.split(x, [3 * count + 4])
        times = own[:3] * SECONDS_PER_DAY
        controls = own[3:-1].reshape(count, 3)
        plans.append(_Plan(float(times[0]), float(times[1]), float(times[2]), controls, float(own[-1])))
    return plans


def _is_within_bounds(problem: Problem, plans: list[_Plan]) -> bool:
    n = problem.n_segments
    shares = [1.0, *((n - outage.segment) / n for outage in problem.outages)]
    return all(_plan_is_within(problem, *pair) for pair in zip(plans, shares, strict=True))


def _plan_is_within(problem: Problem, plan: _Plan, share: float) -> bool:
    bounds = problem.bounds
    low, high = bounds.shooting_days
    start_mass = float(_departure(problem)[1][6])
    return all(
        (
            # Only the upper bound of a realization shrinks for certain: the lower one is read at its least.
            _is_between(plan.shooting / SECONDS_PER_DAY, low * share, high * share),
            _is_between(plan.initial_coast / SECONDS_PER_DAY, *bounds.initial_coast_days),
            _is_between(plan.final_coast / SECONDS_PER_DAY, *bounds.final_coast_days),
            _is_between(plan.controls[:, 0], *bounds.throttle),
            _is_between(plan.controls[:, 1], -pi, pi),
            _is_between(plan.controls[:, 2], -pi / 2, pi / 2),
            _is_between(plan.final_mass, bounds.min_final_mass_kg, start_mass),
        )
    )


def _is_between(values: Array | float, low: float, high: float) -> bool:
    slack = BOUND_SLACK * (high - low)
    return bool(np.all((values >= low - slack) & (values <= high + slack)))


def _departure(problem: Problem) -> tuple[float, Array]:
    """Return the departure epoch [TDB s past J2000] and state (7,) [km, km/s, kg]."""
    start = departure_state(problem.departure, problem.spacecraft)
    return start.et, np.array([*start.position_km, *start.velocity_km_s, start.mass_kg])


def _fly_all(problem: Problem, plans: list[_Plan], naif_id: int) -> tuple[list[_Flown], int]:
    origin_et, state = _departure(problem)
    craft = problem.spacecraft
    pilot = Pilot(origin_et, craft.max_thrust_n, craft.isp_s * G0 * 1e-3)
    reference = _fly(pilot, plans[0], 0.0, state, plans[0].initial_coast, naif_id)
    flights = [reference]
    for outage, plan in zip(problem.outages, plans[1:], strict=True):
        start = reference.start + (outage.segment - 1) * plans[0].segment_duration
        coast = outage.duration_days * SECONDS_PER_DAY + plan.initial_coast
        source = _reference_state_at(plans[0], reference, outage.segment)
        flights.append(_fly(pilot, plan, start, source, coast, naif_id))
    return flights, pilot.n_evaluations


def _reference_state_at(plan: _Plan, reference: _Flown, segment: int) -> Array:
    """Return the reference at the start of a segment, from the half that the segment belongs to."""
    matchpoint = plan.n_forward + 1
    is_forward = segment <= matchpoint
    state: Array = reference.forward[segment - 1] if is_forward else reference.backward[segment - matchpoint]
    return state


def _fly(pilot: Pilot, plan: _Plan, departure: float, state: Array, coast: float, naif_id: int) -> _Flown:
    start = departure + coast
    end = start + plan.shooting
    arrival = end + plan.final_coast
    n_forward, h = plan.n_forward, plan.segment_duration
    forward = np.full((n_forward + 1, 7), np.nan)
    backward = np.full((len(plan.controls) - n_forward + 1, 7), np.nan)
    target_error = (np.nan, np.nan)
    failure = "" if np.all(np.isfinite(state)) else "starts from a reference that could not be flown"
    try:
        if not failure:
            forward[0] = pilot.arc(departure, state, coast)
            for p, control in enumerate(plan.controls[:n_forward]):
                forward[p + 1] = pilot.arc(start + p * h, forward[p], h, pilot.thrust(control))
    except Unflyable as reason:
        failure = str(reason)
    try:
        at_target = np.append(pilot.target_state(naif_id, arrival), plan.final_mass)
        backward[-1] = pilot.arc(arrival, at_target, -plan.final_coast)
        target_error = _distance(backward[-1], pilot.target_state(naif_id, end))
        for p in range(len(plan.controls), n_forward, -1):
            i = p - n_forward
            backward[i - 1] = pilot.arc(start + p * h, backward[i], -h, pilot.thrust(plan.controls[p - 1]))
    except Unflyable as reason:
        failure = failure or str(reason)
    return _Flown(forward, backward, start, arrival, target_error, failure)


def _distance(state: Array, other: Array) -> tuple[float, float]:
    difference = state[:6] - other
    return float(np.linalg.norm(difference[:3])), float(np.linalg.norm(difference[3:]))


def _named(flights: list[_Flown]) -> list[str]:
    names = ["reference", *(f"realization {i}" for i in range(1, len(flights)))]
    return [f"{name} {flown.failure}" for name, flown in zip(names, flights, strict=True) if flown.failure]


@functools.cache
def _digest(kernel: Path, changed: int) -> str:
    return hashlib.blake2b(kernel.read_bytes(), digest_size=16).hexdigest()
