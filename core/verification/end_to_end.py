"""End-to-end propagation: from the departure to the target without a matchpoint or any correction.

A matchpoint hides a defect within its tolerance; here the error grows as it would in flight, and the result
is the distance from the target at arrival.  Units: km, km/s, kg, s past the departure epoch.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from core.constants import SECONDS_PER_DAY
from core.problem import Problem
from core.verification.repropagation import Array, Pilot, Plan, UnflyableError, departure_of, distance


class EndToEnd(NamedTuple):
    """One trajectory propagated end to end; states after a failure are NaN."""

    #: States at the starts of the segments and at the end of the last, (n_segments + 1, 7) [km, km/s, kg].
    states: Array
    #: Distance from the target when the last segment ends, and at arrival after the final coast [km, km/s].
    insertion_miss: tuple[float, float]
    arrival_miss: tuple[float, float]
    #: Mass at arrival minus the m_f of the decision vector [kg].
    mass_miss_kg: float
    failure: str


class CrossCheck(NamedTuple):
    """All trajectories propagated end to end by an integrator of another kind."""

    integrator: str
    version: str
    #: Bound on the remainder of a series, relative to the largest component of the state.
    tolerance: float
    n_steps: int
    #: The reference first.
    flights: tuple[EndToEnd, ...]


def apart(one: EndToEnd, other: EndToEnd) -> tuple[float, float]:
    """Return the largest difference between two propagations of a trajectory at segment ends [km, km/s]."""
    off = one.states - other.states
    position, velocity = (np.linalg.norm(off[:, part], axis=1) for part in (slice(3), slice(3, 6)))
    return float(np.max(position)), float(np.max(velocity))


def propagate_end_to_end(
    pilot: Pilot,
    problem: Problem,
    plans: Sequence[Plan],
    naif_id: int,
    watchers: Sequence[Callable[["scipy.integrate.DOP853"], None] | None],
) -> list[EndToEnd]:
    """Propagate every trajectory end to end; a realization starts from the reference so propagated."""
    reference, *others = plans
    pilot.watcher, *follow = watchers
    _, state = departure_of(problem)
    flown = [_propagate(pilot, reference, 0.0, state, reference.initial_coast, naif_id)]
    for outage, plan, pilot.watcher in zip(problem.outages, others, follow, strict=True):
        start = reference.initial_coast + (outage.segment - 1) * reference.segment_duration
        coast = outage.duration_days * SECONDS_PER_DAY + plan.initial_coast
        flown.append(_propagate(pilot, plan, start, flown[0].states[outage.segment - 1], coast, naif_id))
    return flown


def _propagate(
    pilot: Pilot, plan: Plan, departure: float, state: Array, coast: float, naif_id: int
) -> EndToEnd:
    states, n, h = np.full((len(plan.controls) + 1, 7), np.nan), len(plan.controls), plan.segment_duration
    start, inserted, arrived = departure + coast, (np.nan, np.nan), (np.nan, np.nan)
    end, mass_miss, failure = start + plan.shooting, np.nan, ""
    try:
        if not np.all(np.isfinite(state)):
            raise UnflyableError("starts from a reference that could not be flown through")
        states[0] = pilot.arc(departure, state, coast)
        for p, control in enumerate(plan.controls):
            states[p + 1] = pilot.arc(start + p * h, states[p], h, pilot.thrust(control))
        inserted = distance(states[n], pilot.target_state(naif_id, end))
        final = pilot.arc(end, states[n], plan.final_coast)
        arrived = distance(final, pilot.target_state(naif_id, end + plan.final_coast))
        mass_miss = float(final[6]) - plan.final_mass
    except UnflyableError as reason:
        failure = str(reason)
    return EndToEnd(states, inserted, arrived, mass_miss, failure)
