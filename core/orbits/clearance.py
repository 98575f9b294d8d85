"""Checks that departure and target lie outside the bodies and near the Earth.

Frame: geocentric, axes J2000.  Units: km, TDB seconds past J2000, days past the departure epoch.

    ClearanceError(RuntimeError)   a departure or a target inside a body, or far beyond the Moon
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from core.constants import RADIUS_EARTH_KM, RADIUS_MOON_KM, SECONDS_PER_DAY
from core.ephemeris import EphemerisTable, body_table
from core.ephemeris.tables import positions
from core.errors import UserError
from core.orbits.spiral import departure_state
from core.orbits.target import target_table, window_days
from core.problem import Problem, SpkTarget, calendar_epoch
from core.ranges import FARTHEST_KM
from core.units import LU_KM, TU_DAYS

Array = NDArray[np.float64]

#: Samples of a target's path: one in two and a half hours of 200 days.
_N_SAMPLES = 2000


class ClearanceError(UserError, RuntimeError):
    """A departure or a target inside a body, or far beyond the Moon."""


def check_clearance(problem: Problem, stop: Callable[[], bool] | None = None) -> None:
    """Raise ClearanceError for a departure inside the Moon, or a target that hits a body or leaves the Earth.

    Parameters
    ----------
    problem : Problem
        The problem; `core.problem.require_physical` has checked its numbers.
    stop : callable, optional
        Asked while a spiral is computed whether to give up.

    Raises
    ------
    ClearanceError
        With the field, the value and the likely slip.
    SpiralError, SpkError
        When there is no departure or no target.
    """
    start = departure_state(problem.departure, problem.spacecraft, stop)
    is_given = isinstance(problem.target, SpkTarget)
    last = window_days(problem)[1] if is_given else 1.0
    bodies = body_table(start.et, 0.0, last)
    from_moon = float(np.linalg.norm(start.position_km - _path(bodies, np.zeros(1))[0]))
    if from_moon < RADIUS_MOON_KM:
        raise ClearanceError(
            f"departure: expected a state outside the Moon, radius {RADIUS_MOON_KM} km, got {from_moon:.0f} "
            f"km from its centre at {calendar_epoch(start.et)}; another epoch?"
        )
    if is_given:
        days = np.linspace(0.0, last, _N_SAMPLES, endpoint=False)
        relative = _path(target_table(problem), days)
        _require_clear(start.et + days * SECONDS_PER_DAY, relative, relative + _path(bodies, days))


def _require_clear(epochs: Array, from_moon: Array, from_earth: Array) -> None:
    for body, radius, path in (("Moon", RADIUS_MOON_KM, from_moon), ("Earth", RADIUS_EARTH_KM, from_earth)):
        distances = np.linalg.norm(path, axis=1)
        nearest = int(np.argmin(distances))
        if distances[nearest] < radius:
            raise ClearanceError(
                f"target: expected an orbit outside the {body}, radius {radius} km, got "
                f"{distances[nearest]:.0f} km from its centre at {calendar_epoch(float(epochs[nearest]))}; "
                f"a file in metres, or an object on its surface?"
            )
    farthest = int(np.argmax(distances))
    if distances[farthest] > FARTHEST_KM:
        raise ClearanceError(
            f"target: expected an orbit within {FARTHEST_KM:g} km of the Earth, "
            f"got {distances[farthest]:.3g} km at {calendar_epoch(float(epochs[farthest]))}; "
            f"an object about the Sun?"
        )


def _path(table: EphemerisTable, days: Array) -> Array:
    """Return the first three columns of a table (n, 3) [km]."""
    place = np.empty(table.coefficients.shape[2])
    path = np.empty((days.size, 3))
    for row, day in zip(path, days, strict=True):
        positions(table, day / TU_DAYS, place)
        row[:] = place[:3] * LU_KM
    return path
