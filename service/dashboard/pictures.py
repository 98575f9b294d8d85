"""A flight as JSON, rounded to what a picture can show.

Positions to a kilometre, masses to a gram, times to a second; a sample that is not finite is null.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.analysis.flight import Flight, FlownTrajectory, Path

#: Decimals by what a field is measured in.
DAYS, KM, KM_S, KG, RAD, SHARE = 5, 0, 5, 3, 4, 4


def flight_as_json(flight: Flight) -> dict[str, Any]:
    """Return the trajectories, the Moon's path and the target's as plain data."""
    return {
        "trajectories": [_trajectory(trajectory) for trajectory in flight.trajectories],
        "moon": _path(flight.moon),
        "target": _path(flight.target),
    }


def _trajectory(flown: FlownTrajectory) -> dict[str, Any]:
    return {
        "outage": flown.outage.model_dump() if flown.outage else None,
        "arcs": [
            arc._asdict()
            | {
                "throttle": round(arc.throttle, SHARE),
                "in_plane_rad": round(arc.in_plane_rad, RAD),
                "out_of_plane_rad": round(arc.out_of_plane_rad, RAD),
            }
            for arc in flown.arcs
        ],
        "matchpoint": flown.matchpoint,
        "days": _rounded(flown.days, DAYS),
        "inertial_km": _rounded(flown.inertial_km, KM),
        "rotating_km": _rounded(flown.rotating_km, KM),
        "moon_km": _rounded(flown.moon_km, KM),
        "speed_km_s": _rounded(flown.speed_km_s, KM_S),
        "mass_kg": _rounded(flown.mass_kg, KG),
    }


def _path(path: Path) -> dict[str, Any]:
    return {
        "days": _rounded(path.days, DAYS),
        "inertial_km": _rounded(path.inertial_km, KM),
        "rotating_km": _rounded(path.rotating_km, KM),
        "moon_km": _rounded(path.moon_km, KM),
    }


def _rounded(values: NDArray[np.float64], decimals: int) -> list[Any]:
    rounded = np.round(values, decimals)
    finite = np.isfinite(rounded)
    nullable: NDArray[np.object_] = rounded.astype(object)
    if decimals == 0:
        # Whole numbers travel without their ".0", a quarter of the whole.
        nullable[finite] = rounded[finite].astype(int)
    # JSON has no NaN.
    nullable[~finite] = None
    plain: list[Any] = nullable.tolist()
    return plain
