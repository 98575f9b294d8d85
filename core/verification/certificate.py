"""Certification of a solution: re-propagation in halves and end to end, closest approaches, mass budget.

Input: a problem, its decision vector, and the least altitude allowed.  Output: plain numbers, the same for
the same solution on the same machine; whoever stores them adds the time, the requester and the package
versions.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

from core.ephemeris.kernels import loaded, one_at_a_time
from core.problem import Outage, Problem
from core.verification.closest_approach import Approach, Closest
from core.verification.end_to_end import CrossCheck, EndToEnd, propagate_end_to_end
from core.verification.repropagation import Array, Pilot, Plan, departure_of, pilot_of, plans_of
from core.verification.verify import Verification, load_target, verification_of
from core.world import EARTH, World, world_of


class MassBudget(NamedTuple):
    """Where the mass of one trajectory goes [kg]; coasts and outages use nothing."""

    #: When the parking orbit is left, before the spiral; and when the transfer begins.
    wet: float
    departure: float
    #: Used on the spiral, by the reference until the outage, and in the trajectory's own segments.
    spiral: float
    before_outage: float
    segments: float
    #: From the propagation, and the m_f of the decision vector.
    arrival: float
    stated_arrival: float
    #: What remains above the dry mass; may be negative.
    spare: float


class LowPassage(NamedTuple):
    """A closest approach below the least altitude allowed."""

    #: 0 for the reference.
    trajectory: int
    approach: Approach
    #: Least altitude allowed [km].
    limit_km: float


class MassShortfall(NamedTuple):
    """An arrival with less mass than the spacecraft has without propellant."""

    #: 0 for the reference.
    trajectory: int
    #: Mass at arrival, and the least allowed [kg].
    mass_kg: float
    least_kg: float


@dataclass(frozen=True, slots=True, eq=False)
class Repropagation:
    """One trajectory of a solution as independently propagated."""

    #: None for the reference.
    outage: Outage | None
    #: Closest approaches when propagated in halves, and end to end.
    closest: tuple[Approach, ...]
    closest_through: tuple[Approach, ...]
    through: EndToEnd
    mass: MassBudget


@dataclass(frozen=True, slots=True, eq=False)
class Certification:
    """All that is certified about a solution; trajectory 0 is the reference."""

    verification: Verification
    trajectories: tuple[Repropagation, ...]
    #: Least altitude allowed over each body [km].
    min_altitudes_km: Mapping[str, float]
    marks: tuple[LowPassage, ...]
    lacks: tuple[MassShortfall, ...]
    #: None if it was not requested.
    third: CrossCheck | None = None

    @property
    def level(self) -> Literal["strict", "paper", "none"]:
        """strict, paper or none."""
        found = self.verification
        return "strict" if found.strict else "paper" if found.paper else "none"

    @property
    def is_sound(self) -> bool:
        """Whether the defects are within the loose tolerance, and no closest approach or mass is too low."""
        return self.level != "none" and not self.marks and not self.lacks


def lowest_passages(min_altitude_km: float | None = None, world: World = EARTH) -> Mapping[str, float]:
    """Return the least altitude allowed over each body of a world [km]: as given, or its own.

    Raises
    ------
    ValueError
        When the altitude is negative or not a finite number.
    """
    if min_altitude_km is None:
        return {body.title: body.lowest_km for body in world.solid}
    if not (min_altitude_km >= 0.0 and math.isfinite(min_altitude_km)):
        raise ValueError(
            f"min_altitude_km: expected a number of at least 0, which is the surface, got {min_altitude_km}"
        )
    return {body.title: float(min_altitude_km) for body in world.solid}


@one_at_a_time
def certify(
    problem: Problem, x: Array, min_altitude_km: float | None = None, *, with_heyoka: bool = False
) -> Certification:
    """Re-propagate a solution in halves and end to end, with closest approaches and mass budgets.

    Parameters
    ----------
    problem : Problem
        P_k.
    x : (n_variables,) array
        Decision vector [days, rad, kg], as for `verify`.
    min_altitude_km : float, optional
        Least altitude allowed over every body [km]; None for 200 km over the Earth and 100 km over the Moon.
    with_heyoka : bool
        Whether to cross-check the end-to-end propagation with heyoka, which has to be installed.

    Returns
    -------
    Certification
        The verdict, and for each trajectory its closest approaches [km], its distance from the target at
        arrival when propagated end to end [km, km/s], and its masses [kg].

    Raises
    ------
    ValueError
        When x has another shape than the problem asks for, or is not finite; or a limit is below 0.

    References
    ----------
    docs/verification.md.
    """
    limits = lowest_passages(min_altitude_km, world_of(problem))
    plans, (kernel, naif_id), pilot = plans_of(problem, x), load_target(problem), pilot_of(problem)
    with loaded(world_of(problem).kernel):
        verification = verification_of(problem, plans, kernel, naif_id)
        through = [Closest(pilot) for _ in plans]
        flown_through = propagate_end_to_end(pilot, problem, plans, naif_id, through)
        third = _cross_check(problem, plans, naif_id, verification) if with_heyoka else None
    trajectories = tuple(
        Repropagation(
            outage=problem.outages[i - 1] if i else None,
            closest=verification.closest[i],
            closest_through=through[i].approaches,
            through=flown_through[i],
            mass=_mass(problem, pilot, plans, i),
        )
        for i in range(len(plans))
    )
    return Certification(
        verification=verification,
        trajectories=trajectories,
        min_altitudes_km=limits,
        marks=_low_passages(trajectories, limits),
        lacks=_mass_shortfalls(problem, trajectories),
        third=third,
    )


def _cross_check(problem: Problem, plans: list[Plan], naif_id: int, found: Verification) -> CrossCheck:
    # heyoka is an optional dependency.
    from core.verification.heyoka_check import cross_check

    return cross_check(problem, plans, naif_id, float(found.arrival_et.max()))


def _low_passages(
    trajectories: tuple[Repropagation, ...], limits: Mapping[str, float]
) -> tuple[LowPassage, ...]:
    return tuple(
        LowPassage(index, approach, limits[approach.body])
        for index, flown in enumerate(trajectories)
        for approach in flown.closest
        if not approach.altitude_km >= limits[approach.body]
    )


def _mass_shortfalls(problem: Problem, trajectories: tuple[Repropagation, ...]) -> tuple[MassShortfall, ...]:
    least = problem.least_final_mass_kg
    arriving = [min(flown.mass.arrival, flown.mass.stated_arrival) for flown in trajectories]
    # The mass has the tolerance of a defect.
    return tuple(
        MassShortfall(index, mass, least)
        for index, mass in enumerate(arriving)
        if not mass >= least - world_of(problem).strict.mass_kg
    )


def _mass(problem: Problem, pilot: Pilot, plans: list[Plan], index: int) -> MassBudget:
    """Return the masses of a trajectory, from the mass flow of each segment."""
    wet, departure = problem.spacecraft.wet_mass_kg, float(departure_of(problem)[1][6])
    outage = problem.outages[index - 1] if index else None
    before = _propellant(pilot, plans[0], outage.segment - 1) if outage else 0.0
    used = _propellant(pilot, plans[index], len(plans[index].controls))
    arrival = departure - before - used
    return MassBudget(
        wet=wet,
        departure=departure,
        spiral=wet - departure,
        before_outage=before,
        segments=used,
        arrival=arrival,
        stated_arrival=plans[index].final_mass,
        spare=arrival - problem.spacecraft.dry_mass_kg,
    )


def _propellant(pilot: Pilot, plan: Plan, n_segments: int) -> float:
    return sum(pilot.thrust(control)[3] * plan.segment_duration for control in plan.controls[:n_segments])
