"""Checks that departure and target lie outside the bodies and not too far from the centre.

Frame: origin at the centre of the world, axes J2000.  Units: km, TDB seconds past J2000, days past the
departure epoch.

    ClearanceError(RuntimeError)   a departure or a target inside a body, or too far from the centre
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from core.constants import SECONDS_PER_DAY
from core.ephemeris import EphemerisTable, body_table
from core.ephemeris.tables import positions
from core.epochs import calendar_epoch
from core.errors import UserError
from core.orbits.spiral import departure_state
from core.orbits.target import target_table, window_days
from core.problem import Problem, SpkTarget
from core.ranges import FARTHEST_KM
from core.world import Body, world_of

Array = NDArray[np.float64]

#: How near to a planet that pulls together with its moons nothing begins or ends [km]: there its pull is not
#: that of one point.
_PLANET_KM = {
    "VENUS BARYCENTER": 6_100.0,
    "EARTH BARYCENTER": 450_000.0,
    "MARS BARYCENTER": 3_400.0,
    "JUPITER BARYCENTER": 72_000.0,
    "SATURN BARYCENTER": 61_000.0,
    "URANUS BARYCENTER": 26_000.0,
    "NEPTUNE BARYCENTER": 25_000.0,
}
#: Samples of a target's path: one in two and a half hours of 200 days.
_N_SAMPLES = 2000


class ClearanceError(UserError, RuntimeError):
    """A departure or a target inside a body, or too far from the centre."""


def check_clearance(problem: Problem, stop: Callable[[], bool] | None = None) -> None:
    """Raise ClearanceError for a departure inside a body, or a target that hits one or leaves the world.

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
    start, world = departure_state(problem.departure, problem.spacecraft, stop), world_of(problem)
    is_given, lu_km = isinstance(problem.target, SpkTarget), world.units.lu_km
    last = window_days(problem)[1] if is_given else 1.0
    bodies = body_table(start.et, 0.0, last, world=world)
    for number, body in enumerate(world.bodies):
        distance = float(np.linalg.norm(start.position_km - _path(bodies, np.zeros(1), lu_km, number)[0]))
        if distance < (least := _PLANET_KM.get(body.name, 0.0)):
            raise ClearanceError(
                f"departure: expected a state at least {least:g} km from {body.name}, a point that pulls, "
                f"got {distance:.0f} km at {calendar_epoch(start.et)}; leave it out of world.bodies"
            )
        if distance < body.radius_km:
            raise ClearanceError(
                f"departure: expected a state outside the {body.title}, radius {body.radius_km} km, got "
                f"{distance:.0f} km from its centre at {calendar_epoch(start.et)}; "
                f"another epoch{'' if problem.world is None else ', or one body less in world.bodies'}?"
            )
    if is_given:
        days = np.linspace(0.0, last, _N_SAMPLES, endpoint=False)
        # The table is relative to the first body, whose place is the centre where there is none.
        place = _path(target_table(problem), days, lu_km) + _path(bodies, days, lu_km)
        paths = [
            (body, place - _path(bodies, days, lu_km, number)) for number, body in enumerate(world.bodies)
        ]
        _require_clear(start.et + days * SECONDS_PER_DAY, [*paths, (world.center, place)])


def _require_clear(epochs: Array, paths: list[tuple[Body, Array]]) -> None:
    for body, path in paths:
        distances = np.linalg.norm(path, axis=1)
        nearest = int(np.argmin(distances))
        if distances[nearest] < (least := _PLANET_KM.get(body.name, 0.0)):
            raise ClearanceError(
                f"target: expected an orbit at least {least:g} km from {body.name}, a point that pulls, got "
                f"{distances[nearest]:.0f} km at {calendar_epoch(float(epochs[nearest]))}; leave it out of "
                f"world.bodies"
            )
        if distances[nearest] < body.radius_km:
            raise ClearanceError(
                f"target: expected an orbit outside the {body.title}, radius {body.radius_km} km, got "
                f"{distances[nearest]:.0f} km from its centre at {calendar_epoch(float(epochs[nearest]))}; "
                f"a file in metres, or an object on its surface?"
            )
    center, farthest = paths[-1][0], int(np.argmax(distances))
    if distances[farthest] > FARTHEST_KM[center.name]:
        slip = 'did you mean center = "SUN"?' if center.name == "EARTH" else "a file in metres?"
        raise ClearanceError(
            f"target: expected an orbit within {FARTHEST_KM[center.name]:g} km of the {center.title}, "
            f"got {distances[farthest]:.3g} km at {calendar_epoch(float(epochs[farthest]))}; {slip}"
        )


def _path(table: EphemerisTable, days: Array, lu_km: float, number: int = 0) -> Array:
    """Return three columns of a table (n, 3) [km]: those of the body of a number from 0."""
    place = np.empty(table.coefficients.shape[2])
    path = np.empty((days.size, 3))
    for row, day in zip(path, days, strict=True):
        positions(table, day / table.tu_days, place)
        row[:] = place[3 * number : 3 * number + 3] * lu_km
    return path
