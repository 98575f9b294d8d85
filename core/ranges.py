"""Plausible ranges of a problem's fields, and the likely slip behind a value outside them.

`core.problem.require_physical` calls this module.  A line reads
`<field>: expected <range>, got <value>; <likely slip>`.
"""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from core.constants import RADIUS_EARTH_KM
from core.world import World, world_of

if TYPE_CHECKING:
    from core.problem import Problem

#: Greatest distance from the centre [km]: from the Earth twice its sphere of influence, and less than its
#: radius in metres; from the Sun as far as Neptune.
FARTHEST_KM = {"EARTH": 3e6, "SUN": 5e9}
#: Greatest speed relative to the centre [km/s]: escape from the Earth's surface takes 11, the Earth flies
#: about the Sun at 30, and at the surface of the Sun escape takes 618.
FASTEST_KM_S = {"EARTH": 25.0, "SUN": 620.0}
#: Latest arrival past the departure epoch [days], for which the target's orbit can be generated.
LATEST_ARRIVAL_DAYS = 3000.0
#: NAIF ids of the bodies of the Earth's force model and of the barycentres, none of which is a target there.
BODIES_OF_MODEL = frozenset((*range(11), 301, 399, 599))

#: Field, least and greatest value, unit, and the likely slip behind a value outside.
RANGES: tuple[tuple[str, float, float, str, str], ...] = (
    ("spacecraft.wet_mass_kg", 0.1, 1e7, "kg", "in grams or tons?"),
    ("spacecraft.dry_mass_kg", 0.01, 1e7, "kg", "in grams or tons?"),
    ("spacecraft.max_thrust_n", 1e-8, 1e5, "N", "in millinewtons or kilonewtons?"),
    ("spacecraft.isp_s", 10.0, 1e5, "s", "an exhaust velocity in km/s or m/s?"),
    ("departure.mass_kg", 0.1, 1e7, "kg", "in grams or tons?"),
    (
        "departure.perigee_radius_km",
        RADIUS_EARTH_KM,
        FARTHEST_KM["EARTH"],
        "km",
        "an altitude, or in metres?",
    ),
    ("departure.apogee_radius_km", RADIUS_EARTH_KM, FARTHEST_KM["EARTH"], "km", "an altitude, or in metres?"),
    ("departure.raan_deg", -3600.0, 3600.0, "deg", "in arcseconds?"),
    ("departure.argument_of_perigee_deg", -3600.0, 3600.0, "deg", "in arcseconds?"),
    ("departure.jacobi", -100.0, 200.0, "in units of the Earth-Moon system", "in km^2/s^2?"),
    ("bounds.min_final_mass_kg", 0.0, 1e7, "kg", "in grams?"),
)


def slips(problem: "Problem") -> list[str]:
    """Return one line per value that is implausible for a spacecraft near the Earth.

    Parameters
    ----------
    problem : Problem
        The problem as given by the user.
    """
    return [*_out_of_range(problem), *_out_of_place(problem)]


def _out_of_range(problem: "Problem") -> Iterator[str]:
    for field, low, high, unit, slip in RANGES:
        part, _, last = field.partition(".")
        value = getattr(getattr(problem, part), last, None)
        if value is not None and not low <= value <= high:
            yield f"{field}: expected {low:g} to {high:g} {unit}, got {value:g}; {slip}"


def _out_of_place(problem: "Problem") -> Iterator[str]:
    departure, target, world = problem.departure, problem.target, world_of(problem)
    if departure.kind == "state":
        distance, speed = math.hypot(*departure.position_km), math.hypot(*departure.velocity_km_s)
        center, farthest, fastest = (
            world.center,
            FARTHEST_KM[world.center.name],
            FASTEST_KM_S[world.center.name],
        )
        is_near_earth = center.name == "EARTH"
        if not center.radius_km <= distance <= farthest:
            far = 'in metres, or did you mean center = "SUN"?' if is_near_earth else "in metres?"
            near = "relative to the surface?" if is_near_earth else "in AU, or relative to the Earth?"
            yield (
                f"departure.position_km: expected {center.radius_km:g} to {farthest:g} km from the "
                f"{center.title}'s centre, got {distance:g}; {far if distance > farthest else near}"
            )
        if speed > fastest:
            slip = "in m/s, or relative to the Sun?" if is_near_earth else "in m/s?"
            yield (
                f"departure.velocity_km_s: expected at most {fastest:g} km/s relative to the {center.title}, "
                f"got {speed:g}; {slip}"
            )
    if target.kind == "spk" and target.naif_id in _pulling(world):
        yield (
            f"target.naif_id: expected a spacecraft or a body that does not pull here, got {target.naif_id}, "
            f"which is a body of the force model; another object, or one body less in world.bodies?"
        )
    if problem.latest_arrival_days > LATEST_ARRIVAL_DAYS:
        yield (
            f"bounds: expected a latest arrival within {LATEST_ARRIVAL_DAYS:g} days of the departure, "
            f"got {problem.latest_arrival_days:g}; in hours or seconds?"
        )


def _pulling(world: World) -> frozenset[int]:
    """Return the NAIF ids of what is no target since it pulls, or is a part of what does."""
    if world.center.name == "EARTH":
        return BODIES_OF_MODEL
    numbers = {body.naif_id for body in (world.center, *world.bodies)}
    planets = {100 * number + part for number in numbers if number < 10 for part in (1, 99)}
    return frozenset(numbers | planets | {number // 100 for number in numbers if number > 100})
