"""Plausible ranges of a problem's fields, and the likely slip behind a value outside them.

`core.problem.require_physical` calls this module.  A line reads
`<field>: expected <range>, got <value>; <likely slip>`.
"""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from core.constants import RADIUS_EARTH_KM

if TYPE_CHECKING:
    from core.problem import Problem

#: Greatest distance of a geocentric state or parking orbit [km]: more than three times the Earth's sphere of
#: influence, and less than the Earth's radius in metres.
FARTHEST_KM = 5e6
#: Greatest geocentric speed [km/s]: escape from the surface takes 11, the Earth flies about the Sun at 30.
FASTEST_KM_S = 25.0
#: Latest arrival past the departure epoch [days], for which the target's orbit can be generated.
LATEST_ARRIVAL_DAYS = 3000.0
#: NAIF ids of the bodies of the force model and of the barycentres, none of which is a target.
BODIES_OF_MODEL = frozenset((*range(11), 301, 399, 599))

#: Field, least and greatest value, unit, and the likely slip behind a value outside.
RANGES: tuple[tuple[str, float, float, str, str], ...] = (
    ("spacecraft.wet_mass_kg", 0.1, 1e7, "kg", "in grams or tons?"),
    ("spacecraft.dry_mass_kg", 0.01, 1e7, "kg", "in grams or tons?"),
    ("spacecraft.max_thrust_n", 1e-8, 1e5, "N", "in millinewtons or kilonewtons?"),
    ("spacecraft.isp_s", 10.0, 1e5, "s", "an exhaust velocity in km/s or m/s?"),
    ("departure.mass_kg", 0.1, 1e7, "kg", "in grams or tons?"),
    ("departure.perigee_radius_km", RADIUS_EARTH_KM, FARTHEST_KM, "km", "an altitude, or in metres?"),
    ("departure.apogee_radius_km", RADIUS_EARTH_KM, FARTHEST_KM, "km", "an altitude, or in metres?"),
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
    departure, target = problem.departure, problem.target
    if departure.kind == "state":
        distance, speed = math.hypot(*departure.position_km), math.hypot(*departure.velocity_km_s)
        if not RADIUS_EARTH_KM <= distance <= FARTHEST_KM:
            slip = "in metres, or from the Sun?" if distance > FARTHEST_KM else "relative to the surface?"
            yield (
                f"departure.position_km: expected {RADIUS_EARTH_KM:g} to {FARTHEST_KM:g} km from the Earth's "
                f"centre, got {distance:g}; {slip}"
            )
        if speed > FASTEST_KM_S:
            yield (
                f"departure.velocity_km_s: expected at most {FASTEST_KM_S:g} km/s relative to the Earth, "
                f"got {speed:g}; in m/s, or relative to the Sun?"
            )
    if target.kind == "spk" and target.naif_id in BODIES_OF_MODEL:
        yield (
            f"target.naif_id: expected a spacecraft or a body without gravity here, got {target.naif_id}, "
            f"which is a body of the force model; the identifier of another object of the file?"
        )
    if problem.latest_arrival_days > LATEST_ARRIVAL_DAYS:
        yield (
            f"bounds: expected a latest arrival within {LATEST_ARRIVAL_DAYS:g} days of the departure, "
            f"got {problem.latest_arrival_days:g}; in hours or seconds?"
        )
