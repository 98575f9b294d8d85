"""What a solution can be trusted with: flown again in halves and through, past which bodies, on what mass.

What flows in: a problem, its decision vector, and how low a trajectory may pass.  What flows out: plain
numbers, the same for the same solution on the same machine; who asked, when, and with which packages is
added by those who store it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

from core.constants import LOWEST_OVER_EARTH_KM, LOWEST_OVER_MOON_KM
from core.ephemeris.kernels import one_at_a_time
from core.problem import Outage, Problem
from core.tolerances import STRICT
from core.verification.closest_approach import Approach, Closest
from core.verification.end_to_end import Third, Through, fly_through
from core.verification.repropagation import Array, Pilot, Plan, departure_of, pilot_of, plans_of
from core.verification.verify import Verification, judged, loaded_target

#: Lowest passages that are not marked where nobody asks for others [km].
LOWEST_KM = {"Earth": LOWEST_OVER_EARTH_KM, "Moon": LOWEST_OVER_MOON_KM}


class MassBudget(NamedTuple):
    """Where the mass of one trajectory goes [kg]; coasts and outages use nothing."""

    #: When the parking orbit is left, before the spiral; and when the transfer begins.
    wet: float
    departure: float
    #: Used on the spiral, by the reference until the outage, and in the trajectory's own segments.
    spiral: float
    before_outage: float
    segments: float
    #: Found by the flight, as against the m_f of the decision vector.
    arrival: float
    stated_arrival: float
    #: What is left above the dry mass; may be negative.
    spare: float


class Mark(NamedTuple):
    """A passage that is too low."""

    #: 0 for the reference.
    trajectory: int
    approach: Approach
    #: How low it may be [km].
    limit_km: float


class Lack(NamedTuple):
    """An arrival with less mass than the spacecraft has without propellant."""

    #: 0 for the reference.
    trajectory: int
    #: What arrives, and what has to [kg].
    mass_kg: float
    least_kg: float


@dataclass(frozen=True, slots=True, eq=False)
class Repropagation:
    """One trajectory of a solution as an independent flight finds it."""

    #: None for the reference.
    outage: Outage | None
    #: Closest approaches as planned, in halves, and flown through.
    closest: tuple[Approach, ...]
    closest_through: tuple[Approach, ...]
    through: Through
    mass: MassBudget


@dataclass(frozen=True, slots=True, eq=False)
class Certification:
    """All that is certified about a solution; trajectory 0 is the reference."""

    verification: Verification
    trajectories: tuple[Repropagation, ...]
    #: How low a trajectory may pass each body [km].
    min_altitudes_km: Mapping[str, float]
    marks: tuple[Mark, ...]
    lacks: tuple[Lack, ...]
    #: None where nobody asked for it.
    third: Third | None = None

    @property
    def level(self) -> Literal["strict", "paper", "none"]:
        """strict, paper or none."""
        found = self.verification
        return "strict" if found.strict else "paper" if found.paper else "none"

    @property
    def is_sound(self) -> bool:
        """Whether the defects hold, at least at the paper's tolerance, and no passage or mass is too low."""
        return self.level != "none" and not self.marks and not self.lacks


def lowest_passages(min_altitude_km: float | None = None) -> Mapping[str, float]:
    """Return how low each body may be passed [km]: as asked, or 200 km for the Earth and 100 for the Moon.

    Raises
    ------
    ValueError
        When an altitude below the surface is asked for, or what is no number.
    """
    if min_altitude_km is None:
        return LOWEST_KM
    if not (min_altitude_km >= 0.0 and math.isfinite(min_altitude_km)):
        raise ValueError(
            f"min_altitude_km: expected a number of at least 0, which is the surface, got {min_altitude_km}"
        )
    return dict.fromkeys(LOWEST_KM, float(min_altitude_km))


@one_at_a_time
def certify(
    problem: Problem, x: Array, min_altitude_km: float | None = None, with_heyoka: bool = False
) -> Certification:
    """Fly a solution again, in halves and through, and take stock.

    Parameters
    ----------
    problem : Problem
        P_k.
    x : (n_variables,) array
        Decision vector [days, rad, kg], as for `verify`.
    min_altitude_km : float, optional
        Lowest passage of the Earth or the Moon that is not marked [km]; None for 200 km over the Earth and
        100 km over the Moon.
    with_heyoka : bool
        Whether it is flown through a third time, by heyoka, which has to be installed.

    Returns
    -------
    Certification
        The verdict, and for each trajectory its closest approaches [km], how far from the target it arrives
        if nothing is corrected [km, km/s], and its masses [kg].

    Raises
    ------
    ValueError
        When x has another shape than the problem asks for, or is not finite; or a limit is below 0.

    References
    ----------
    docs/verification.md.
    """
    limits = lowest_passages(min_altitude_km)
    plans, (kernel, naif_id), pilot = plans_of(problem, x), loaded_target(problem), pilot_of(problem)
    verification = judged(problem, plans, kernel, naif_id)
    through = [Closest(pilot) for _ in plans]
    flown_through = fly_through(pilot, problem, plans, naif_id, through)
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
        marks=_too_low(trajectories, limits),
        lacks=_too_light(problem, trajectories),
        third=_third(problem, plans, naif_id, verification) if with_heyoka else None,
    )


def _third(problem: Problem, plans: list[Plan], naif_id: int, found: Verification) -> Third:
    # Few install the package that it needs.
    from core.verification.heyoka_check import fly_third

    return fly_third(problem, plans, naif_id, float(found.arrival_et.max()))


def _too_low(trajectories: tuple[Repropagation, ...], limits: Mapping[str, float]) -> tuple[Mark, ...]:
    return tuple(
        Mark(index, approach, limits[approach.body])
        for index, flown in enumerate(trajectories)
        for approach in flown.closest
        if not approach.altitude_km >= limits[approach.body]
    )


def _too_light(problem: Problem, trajectories: tuple[Repropagation, ...]) -> tuple[Lack, ...]:
    least = problem.least_final_mass_kg
    arriving = [min(flown.mass.arrival, flown.mass.stated_arrival) for flown in trajectories]
    # The mass may be off by as much as a defect may.
    return tuple(
        Lack(index, mass, least) for index, mass in enumerate(arriving) if not mass >= least - STRICT.mass_kg
    )


def _mass(problem: Problem, pilot: Pilot, plans: list[Plan], index: int) -> MassBudget:
    """Return the masses of a trajectory, by the flow of each of its segments."""
    wet, departure = problem.spacecraft.wet_mass_kg, float(departure_of(problem)[1][6])
    outage = problem.outages[index - 1] if index else None
    before = _used(pilot, plans[0], outage.segment - 1) if outage else 0.0
    used = _used(pilot, plans[index], len(plans[index].controls))
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


def _used(pilot: Pilot, plan: Plan, n_segments: int) -> float:
    return sum(pilot.thrust(control)[3] * plan.segment_duration for control in plan.controls[:n_segments])
