"""Closest approaches to the bodies that a path may hit, found between the integrator's steps too.

Where the range rate passes from below zero to above, the distance has its least value; the root is found on
the integrator's own interpolant, so a passage between two steps is not missed.  Units: km, km/s, s past the
departure epoch.
"""

from typing import NamedTuple

import numpy as np
import scipy

from core.constants import SECONDS_PER_DAY
from core.verification.repropagation import Array, Pilot

#: Tolerance on the time of a root [s].
TIME_TOLERANCE_S = 1e-6


class Approach(NamedTuple):
    """The least distance of a trajectory from a body."""

    body: str
    #: From the centre, and above the mean equatorial radius [km].
    distance_km: float
    altitude_km: float
    #: Epoch [TDB s past J2000] and the same in days past the departure.
    et: float
    days: float
    #: Whether the range rate passes through zero there; else a half of the trajectory begins or ends there.
    is_turn: bool


class Closest:
    """Observes the steps of an integration and keeps the closest approach to each body."""

    def __init__(self, pilot: Pilot) -> None:
        self._pilot = pilot
        #: Those that a path may hit, by NAIF id.
        self._watched = {body.naif_id: body for body in (pilot.center, *pilot.bodies) if body.radius_km > 0.0}
        self._found: dict[int, tuple[float, float, bool]] = {}

    def __call__(self, solver: "scipy.integrate.DOP853") -> None:
        """Process the step that an integrator has just made."""
        ends = ((float(solver.t_old), solver.y_old), (float(solver.t), solver.y))
        (start, first), (stop, last) = sorted(ends, key=lambda end: end[0])
        for body in self._watched:
            before, after = self._relative_state(body, start, first), self._relative_state(body, stop, last)
            self._keep(body, start, before, is_turn=False)
            self._keep(body, stop, after, is_turn=False)
            # A step spans less than a tenth of a revolution, in which the distance has one minimum at most.
            # The interpolant costs a quarter of a step, so it is made for those that have one.
            if _range_rate(before) < 0.0 <= _range_rate(after):
                self._keep_turn(solver.dense_output(), body, start, stop)

    @property
    def approaches(self) -> tuple[Approach, ...]:
        """The closest approach to each body, as far as the trajectory was propagated."""
        origin = self._pilot.origin_et
        return tuple(
            Approach(
                body.title,
                distance,
                distance - body.radius_km,
                origin + time,
                time / SECONDS_PER_DAY,
                is_turn,
            )
            for body, (distance, time, is_turn) in (
                (self._watched[number], self._found[number])
                for number in self._watched
                if number in self._found
            )
        )

    def _keep_turn(self, path: "scipy.integrate.DenseOutput", body: int, before: float, after: float) -> None:
        def rate(time: float) -> float:
            return _range_rate(self._relative_state(body, time, path(time)))

        root = float(scipy.optimize.brentq(rate, before, after, xtol=TIME_TOLERANCE_S))
        self._keep(body, root, self._relative_state(body, root, path(root)), is_turn=True)

    def _keep(self, body: int, time: float, state: Array, is_turn: bool) -> None:
        distance = float(np.linalg.norm(state[:3]))
        if body not in self._found or distance < self._found[body][0]:
            self._found[body] = (distance, time, is_turn)

    def _relative_state(self, body: int, time: float, state: Array) -> Array:
        return (
            state
            if body == self._pilot.center.naif_id
            else state - np.array(self._pilot.state_of(body, time))
        )


def _range_rate(state: Array) -> float:
    """Return the range rate times the distance, which has the same sign; docs/method.md, eq. V5."""
    return float(state[:3] @ state[3:])
