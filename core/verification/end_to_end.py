"""A solution flown through: from the departure to the target with no matchpoint and nothing corrected.

What a matchpoint hides is a defect within its tolerance; here it grows as it would in flight, and what is
reported is how far from the target each trajectory arrives.  Units: km, km/s, kg, s past the departure epoch.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from core.constants import SECONDS_PER_DAY
from core.problem import Problem
from core.verification.repropagation import Array, Pilot, Plan, UnflyableError, departure_of, distance


class Through(NamedTuple):
    """One trajectory flown through; what lies behind a failure is not a number."""

    #: States at the starts of the segments and at the end of the last, (n_segments + 1, 7) [km, km/s, kg].
    states: Array
    #: Distance from the target when the last segment ends, and at arrival after the final coast [km, km/s].
    insertion_miss: tuple[float, float]
    arrival_miss: tuple[float, float]
    #: Mass at arrival minus the one that the decision vector names [kg].
    mass_miss_kg: float
    failure: str


class Third(NamedTuple):
    """All trajectories flown through once more, by an integrator of another kind."""

    integrator: str
    version: str
    #: Of the remainder of a series, relative to the largest component of the state.
    tolerance: float
    n_steps: int
    #: The reference first.
    flights: tuple[Through, ...]


def apart(one: Through, other: Through) -> tuple[float, float]:
    """Return how far two flights of a trajectory are apart at most, at the ends of segments [km, km/s]."""
    off = one.states - other.states
    position, velocity = (np.linalg.norm(off[:, part], axis=1) for part in (slice(3), slice(3, 6)))
    return float(np.max(position)), float(np.max(velocity))


def fly_through(
    pilot: Pilot,
    problem: Problem,
    plans: Sequence[Plan],
    naif_id: int,
    watchers: Sequence[Callable[["scipy.integrate.DOP853"], None] | None],
) -> list[Through]:
    """Return every trajectory flown through; a realization leaves the reference as that was flown through."""
    reference, *others = plans
    pilot.watcher, *follow = watchers
    _, state = departure_of(problem)
    flown = [_through(pilot, reference, 0.0, state, reference.initial_coast, naif_id)]
    for outage, plan, pilot.watcher in zip(problem.outages, others, follow, strict=True):
        start = reference.initial_coast + (outage.segment - 1) * reference.segment_duration
        coast = outage.duration_days * SECONDS_PER_DAY + plan.initial_coast
        flown.append(_through(pilot, plan, start, flown[0].states[outage.segment - 1], coast, naif_id))
    return flown


def _through(pilot: Pilot, plan: Plan, departure: float, state: Array, coast: float, naif_id: int) -> Through:
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
    return Through(states, inserted, arrived, mass_miss, failure)
