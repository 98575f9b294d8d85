"""A solution in halves, as the verifier flies it: forward from the departure, backward from the target.

The layout of x, the segments and the outages are read here a second time on purpose: no line is shared with
`core.transcription` or `core.dynamics`.  Units: km, km/s, kg, s; times in seconds past the departure epoch.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from core.analysis.reflight import RTOL, Array, Pilot, Unflyable
from core.constants import G0, SECONDS_PER_DAY
from core.orbits import departure_state
from core.problem import Problem


class Plan(NamedTuple):
    """The part of x that belongs to one trajectory; times in seconds."""

    shooting: float
    initial_coast: float
    final_coast: float
    controls: Array  # (n_segments, 3)
    final_mass: float

    @property
    def n_forward(self) -> int:
        """Number of segments flown forward."""
        return len(self.controls) // 2

    @property
    def segment_duration(self) -> float:
        """Length of a segment [s]."""
        return self.shooting / len(self.controls)


class Flown(NamedTuple):
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


def _segment_counts(problem: Problem) -> list[int]:
    n = problem.n_segments
    adaptive = problem.segmentation == "adaptive"
    return [n, *(n - outage.segment if adaptive else n for outage in problem.outages)]


def plans_of(problem: Problem, x: Array) -> list[Plan]:
    """Return the reference and the realizations of x, or raise ValueError saying why x is no such vector."""
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
        plans.append(Plan(float(times[0]), float(times[1]), float(times[2]), controls, float(own[-1])))
    return plans


def departure_of(problem: Problem) -> tuple[float, Array]:
    """Return the departure epoch [TDB s past J2000] and state (7,) [km, km/s, kg]."""
    start = departure_state(problem.departure, problem.spacecraft)
    return start.et, np.array([*start.position_km, *start.velocity_km_s, start.mass_kg])


def pilot_of(problem: Problem, rtol: float = RTOL) -> Pilot:
    """Return who flies a problem's arcs."""
    craft = problem.spacecraft
    return Pilot(departure_of(problem)[0], craft.max_thrust_n, craft.isp_s * G0 * 1e-3, rtol)


def fly_all(
    pilot: Pilot,
    problem: Problem,
    plans: list[Plan],
    naif_id: int,
    watchers: Sequence[Callable[["scipy.integrate.DOP853"], None] | None],
) -> list[Flown]:
    """Return every trajectory in halves; a watcher follows the steps of each."""
    pilot.watcher, *others = watchers
    _, state = departure_of(problem)
    reference = _fly(pilot, plans[0], 0.0, state, plans[0].initial_coast, naif_id)
    flights = [reference]
    for outage, plan, pilot.watcher in zip(problem.outages, plans[1:], others, strict=True):
        start = reference.start + (outage.segment - 1) * plans[0].segment_duration
        coast = outage.duration_days * SECONDS_PER_DAY + plan.initial_coast
        source = _reference_state_at(plans[0], reference, outage.segment)
        flights.append(_fly(pilot, plan, start, source, coast, naif_id))
    return flights


def _reference_state_at(plan: Plan, reference: Flown, segment: int) -> Array:
    """Return the reference at the start of a segment, from the half that the segment belongs to."""
    matchpoint = plan.n_forward + 1
    is_forward = segment <= matchpoint
    state: Array = reference.forward[segment - 1] if is_forward else reference.backward[segment - matchpoint]
    return state


def _fly(pilot: Pilot, plan: Plan, departure: float, state: Array, coast: float, naif_id: int) -> Flown:
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
        target_error = distance(backward[-1], pilot.target_state(naif_id, end))
        for p in range(len(plan.controls), n_forward, -1):
            i = p - n_forward
            backward[i - 1] = pilot.arc(start + p * h, backward[i], -h, pilot.thrust(plan.controls[p - 1]))
    except Unflyable as reason:
        failure = failure or str(reason)
    return Flown(forward, backward, start, arrival, target_error, failure)


def distance(state: Array, other: Array) -> tuple[float, float]:
    """Return how far two states are apart, in position and in velocity."""
    difference = state[:6] - other
    return float(np.linalg.norm(difference[:3])), float(np.linalg.norm(difference[3:]))
