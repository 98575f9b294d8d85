"""What a problem's thrust can reach, and what it was tested for: said before an hour is spent on guesses.

Units: km, km/s, kg, days.
"""

from math import inf, log, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.constants import G0, SECONDS_PER_DAY
from core.ephemeris import state_at
from core.orbits.spiral import DepartureState, departure_state
from core.orbits.target import target_table
from core.problem import Problem
from core.world import world_of

Array = NDArray[np.float64]

#: Accelerations at departure [mm/s^2], longest shooting time [days] and wet masses [kg] of the problems that
#: the solver is tested on: docs/own-problem.md.
TESTED_MM_S2, TESTED_DAYS, TESTED_KG = (0.03, 1.0), 2500.0, (10.0, 100_000.0)
# Arrivals at which the target is looked at, and how much faster and farther out than either orbit a transfer
# may be: a low thrust between them is far from that.
_N_ARRIVALS, _BEYOND = 50, 2.0


class Reach(NamedTuple):
    """Delta-v of a problem [km/s]."""

    #: With full thrust for the longest shooting time, or until the least final mass.
    reachable_km_s: float
    #: No transfer needs less; 0 where that is not known, as where other bodies help.
    needed_km_s: float


def reach_of(problem: Problem) -> Reach:
    """Return what a problem's thrust can reach, and a lower bound of what it has to.

    Parameters
    ----------
    problem : Problem
        Its departure can be computed, and its target is known until the latest arrival.
    """
    craft, start = problem.spacecraft, departure_state(problem.departure, problem.spacecraft)
    exhaust = craft.isp_s * G0 * 1e-3
    flow = problem.bounds.throttle[1] * craft.max_thrust_n / (1e3 * exhaust)
    burnt = flow * problem.bounds.shooting_days[1] * SECONDS_PER_DAY
    left = max(start.mass_kg - burnt, craft.dry_mass_kg, problem.bounds.min_final_mass_kg)
    reachable = exhaust * log(start.mass_kg / left) if left < start.mass_kg else 0.0
    return Reach(reachable, _needed(problem, start))


def _needed(problem: Problem, start: DepartureState) -> float:
    """Return the least change of orbit about a centre that pulls alone.

    |dE/dt| <= |v| |a| and |dh/dt| <= |r| |a|, v and r at most `_BEYOND` times those of either orbit.
    """
    world, box = world_of(problem), problem.bounds
    if world.center.name != "SUN" or world.bodies:
        return 0.0
    gm, table = world.center.gm_km3_s2, target_table(problem)
    earliest, latest = (sum(side) for side in zip(box.shooting_days, box.initial_coast_days, strict=True))
    ends = []
    for days in np.linspace(earliest, latest, _N_ARRIVALS):
        place, rate, _ = state_at(table, days)
        ends.append((place[:3] * world.units.lu_km, rate[:3] * world.units.vu_km_s))
    first = np.array(start.position_km), np.array(start.velocity_km_s)
    return min(_apart(gm, first, end) for end in ends)


def _apart(gm: float, first: tuple[Array, Array], second: tuple[Array, Array]) -> float:
    """Return a lower bound of the delta-v between two orbits that are given by a state each [km/s]."""
    orbits = [_orbit(gm, *state) for state in (first, second)]
    fastest = _BEYOND * max(fastest for *_, fastest, _ in orbits)
    farthest = _BEYOND * max(farthest for *_, farthest in orbits)
    (energy, momentum, *_), (other_energy, other_momentum, *_) = orbits
    by_momentum = float(np.linalg.norm(momentum - other_momentum)) / farthest
    return max(abs(energy - other_energy) / fastest, by_momentum)


def _orbit(gm: float, place: Array, velocity: Array) -> tuple[float, Array, float, float]:
    """Return energy [km^2/s^2], angular momentum [km^2/s], greatest speed [km/s] and radius [km]."""
    momentum = np.cross(place, velocity)
    energy = float(velocity @ velocity) / 2.0 - gm / float(np.linalg.norm(place))
    eccentricity = sqrt(max(0.0, 1.0 + 2.0 * energy * float(momentum @ momentum) / gm**2))
    size = float(np.linalg.norm(momentum))
    farthest = inf if eccentricity >= 1.0 else size**2 / gm / (1.0 - eccentricity)
    return energy, momentum, gm * (1.0 + eccentricity) / size, farthest


def remarks_on(problem: Problem) -> list[str]:
    """Return what somebody should know before a search: thrust that cannot suffice, and untested ground.

    Parameters
    ----------
    problem : Problem
        As for `reach_of`.
    """
    craft, box = problem.spacecraft, problem.bounds
    reach, start = reach_of(problem), departure_state(problem.departure, craft)
    days = box.shooting_days[1]
    remarks = []
    if reach.reachable_km_s < reach.needed_km_s:
        remarks.append(
            f"no guess can close: {craft.max_thrust_n:g} N for {days:g} days on {start.mass_kg:g} kg give at "
            f"most {reach.reachable_km_s:.3g} km/s, and the change of orbit needs at least "
            f"{reach.needed_km_s:.3g} km/s; allow more thrust, longer bounds.shooting_days, less mass, or a "
            "smaller least final mass"
        )
    push = 1e3 * craft.max_thrust_n / start.mass_kg
    for name, value, unit, (low, high) in (
        ("acceleration at departure", push, "mm/s^2", TESTED_MM_S2),
        ("longest shooting time", days, "days", (0.0, TESTED_DAYS)),
        ("wet mass", craft.wet_mass_kg, "kg", TESTED_KG),
    ):
        if not low <= value <= high:
            remarks.append(
                f"{name}: {value:.3g} {unit} is outside the tested range of {low:g} to {high:g} {unit}; try "
                "`coastarc bench solve` with a few guesses first"
            )
    return remarks
