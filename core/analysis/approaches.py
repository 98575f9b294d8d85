"""How close a flight comes to the Earth and to the Moon, between the integrator's steps too.

Where the range rate passes from below zero to above, the distance has its least value; the root is found on
the integrator's own interpolant, so a passage between two steps is not missed.  Units: km, km/s, s past the
departure epoch.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy

from core.analysis.reflight import EARTH, MOON, Array, Pilot
from core.constants import RADIUS_EARTH_KM, RADIUS_MOON_KM, SECONDS_PER_DAY

#: Name and radius [km] of the bodies that are watched, by NAIF id.
WATCHED = {EARTH: ("Earth", RADIUS_EARTH_KM), MOON: ("Moon", RADIUS_MOON_KM)}
#: A step is searched in so many parts: it spans less than a tenth of a revolution, so each turns once.
PARTS = 4
#: What the time of a root may be off by [s].
TIME_TOLERANCE_S = 1e-6


class Approach(NamedTuple):
    """The least distance of a flight from a body."""

    body: str
    #: From the centre, and above the mean equatorial radius [km].
    distance_km: float
    altitude_km: float
    #: Epoch [TDB s past J2000] and the same in days past the departure.
    et: float
    days: float
    #: Whether the range rate passes through zero there; else a half of the flight begins or ends there.
    is_turn: bool


class Closest:
    """Follows the steps of a pilot and keeps the closest approach to each body."""

    def __init__(self, pilot: Pilot) -> None:
        self._pilot = pilot
        self._found: dict[int, tuple[float, float, bool]] = {}

    def __call__(self, solver: "scipy.integrate.DOP853") -> None:
        """Look at the step that an integrator has just made."""
        path = solver.dense_output()
        start, stop = sorted((float(solver.t_old), float(solver.t)))
        times = [float(time) for time in np.linspace(start, stop, PARTS + 1)]
        for body in WATCHED:
            rates = [self._range_rate(path, body, time) for time in times]
            self._keep(path, body, start, is_turn=False)
            self._keep(path, body, stop, is_turn=False)
            for (before, after), (low, high) in zip(pairwise(times), pairwise(rates), strict=True):
                if low < 0.0 <= high:
                    root = scipy.optimize.brentq(
                        lambda t, b=body: self._range_rate(path, b, t), before, after, xtol=TIME_TOLERANCE_S
                    )
                    self._keep(path, body, float(root), is_turn=True)

    @property
    def approaches(self) -> tuple[Approach, ...]:
        """The closest approach to each body, as far as there was a flight."""
        origin = self._pilot.origin_et
        return tuple(
            Approach(name, distance, distance - radius, origin + time, time / SECONDS_PER_DAY, is_turn)
            for (name, radius), (distance, time, is_turn) in (
                (WATCHED[body], self._found[body]) for body in WATCHED if body in self._found
            )
        )

    def _keep(self, path: object, body: int, time: float, is_turn: bool) -> None:
        position, _ = self._relative(path, body, time)
        distance = float(np.linalg.norm(position))
        if body not in self._found or distance < self._found[body][0]:
            self._found[body] = (distance, time, is_turn)

    def _range_rate(self, path: object, body: int, time: float) -> float:
        """Return the range rate times the distance, which has the same sign; docs/method.md, eq. V5."""
        position, velocity = self._relative(path, body, time)
        return float(position @ velocity)

    def _relative(self, path: object, body: int, time: float) -> tuple[Array, Array]:
        state: Array = path(time)  # type: ignore[operator]
        if body != EARTH:
            state = state - np.array(self._pilot.state_of(body, time))
        return state[:3], state[3:6]
