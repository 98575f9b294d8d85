"""Plausible ranges of a problem's fields, and the likely slip behind a value outside them.

`core.problem.require_physical` calls this module.  A line reads
`<field>: expected <range>, got <value>; <likely slip>`.
"""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from core.constants import RADIUS_EARTH_KM
from core.world import BODIES, World, world_of

if TYPE_CHECKING:
    from core.problem import Problem

#: Greatest distance from the centre [km]: from the Earth twice its sphere of influence, and less than its
#: radius in metres; from the Sun as far as Neptune.
FARTHEST_KM = {"EARTH": 3e6, "SUN": 5e9}
#: Least distance from the Sun as the centre [km]: no probe has been nearer, but states about the Earth are.
NEAREST_TO_SUN_KM = 5e6
#: How many times more or less than that of DE440 a gravitational parameter may be; m^3/s^2 are a billion.
MOST_TIMES_GM = 1000.0
#: Greatest speed relative to the centre [km/s]: escape from the Earth's surface takes 11, the Earth flies
#: about the Sun at 30, and at the surface of the Sun escape takes 618.
FASTEST_KM_S = {"EARTH": 25.0, "SUN": 620.0}
#: Latest arrival past the departure epoch [days], for which the target's orbit can be generated.
LATEST_ARRIVAL_DAYS = 3000.0
#: NAIF ids of the bodies of the Earth's usual world and of the barycentres, none of which is a target there.
BODIES_OF_MODEL = frozenset((*range(11), 301, 399, 599))

_OTHER_CENTER = 'did you mean center = "SUN"?'

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
    target, world = problem.target, world_of(problem)
    slips = [*_off_center(problem, world)]
    yield from slips
    if slips and slips[-1].endswith(_OTHER_CENTER):
        # What else is strange follows from it.
        return
    if slip := _gm_slip(world):
        yield slip
    if target.kind == "spk" and target.naif_id in _pulling(problem, world):
        yield (
            f"target.naif_id: expected a spacecraft or a body that does not pull here, got {target.naif_id}, "
            f"which is a body of the force model or a part of one; another object, or one body less in "
            f"world.bodies?"
        )
    if problem.latest_arrival_days > LATEST_ARRIVAL_DAYS:
        yield (
            f"bounds: expected a latest arrival within {LATEST_ARRIVAL_DAYS:g} days of the departure, "
            f"got {problem.latest_arrival_days:g}; in hours or seconds?"
        )


def _gm_slip(world: World) -> str | None:
    """Return what is wrong with the first gravitational parameter that is."""
    for body in (world.center, *world.bodies):
        least, most = (BODIES[body.name].gm_km3_s2 * times for times in (1.0 / MOST_TIMES_GM, MOST_TIMES_GM))
        if not least <= body.gm_km3_s2 <= most:
            return (
                f"world.gm_km3_s2: expected {least:.4g} to {most:.4g} km^3/s^2 for {body.name}, got "
                f"{body.gm_km3_s2:g}; in m^3/s^2, or not in the order of the centre and then bodies?"
            )
    return None


def _off_center(problem: "Problem", world: World) -> Iterator[str]:
    """Yield what a departure says that fits another centre or another unit."""
    departure, center = problem.departure, world.center
    if departure.kind != "state":
        return
    distance, speed = math.hypot(*departure.position_km), math.hypot(*departure.velocity_km_s)
    is_near_earth = center.name == "EARTH"
    nearest = center.radius_km if is_near_earth else NEAREST_TO_SUN_KM
    farthest, fastest = FARTHEST_KM[center.name], FASTEST_KM_S[center.name]
    if not nearest <= distance <= farthest:
        far = f"in metres, or {_OTHER_CENTER}" if is_near_earth else "in metres?"
        near = "relative to the surface?" if is_near_earth else 'in AU, or did you mean center = "EARTH"?'
        yield (
            f"departure.position_km: expected {nearest:g} to {farthest:g} km from the {center.title}'s "
            f"centre, got {distance:g}; {far if distance > farthest else near}"
        )
        if is_near_earth and farthest < distance <= FARTHEST_KM["SUN"] and speed <= FASTEST_KM_S["SUN"]:
            return
    if speed > fastest:
        slip = "in m/s, or relative to the Sun?" if is_near_earth else "in m/s?"
        yield (
            f"departure.velocity_km_s: expected at most {fastest:g} km/s relative to the {center.title}, "
            f"got {speed:g}; {slip}"
        )


def _pulling(problem: "Problem", world: World) -> frozenset[int]:
    """Return the NAIF ids of what is no target since it pulls, or is a part of what does."""
    if problem.world is None:
        return BODIES_OF_MODEL
    numbers = {body.naif_id for body in (world.center, *world.bodies)}
    planets = {100 * number + part for number in numbers if number < 10 for part in (1, 99)}
    # The barycentre of the solar system is at the surface of the Sun.
    return frozenset(numbers | planets | {number // 100 for number in numbers if number > 100} | {0, 10})
