"""Single arcs and single states, for those who build guesses rather than evaluate them."""

import numpy as np
from numpy.typing import NDArray

from core.dynamics import STATE as STATE_ONLY
from core.dynamics import propagate
from core.ephemeris import states
from core.transcription.control import throttle_of, thrust_of
from core.transcription.transcription import Transcription
from core.units import TU_DAYS

Array = NDArray[np.float64]
_COAST = np.zeros(3)


def fly_arc(
    transcription: Transcription, start: Array, t_a: float, t_b: float, control: Array = _COAST
) -> Array:
    """Return the state at the end of one arc, NaN where it cannot be flown.

    Parameters
    ----------
    transcription : Transcription
        Forces and tolerance.
    start : (7,) array
        State at t_a [LU, VU, MU].
    t_a, t_b : float
        Start and end, in either order [TU past departure].
    control : (3,) array
        Throttle [-] and angles [rad]; a coast by default.
    """
    model = transcription.setting.model
    thrust, partials = np.zeros(3), np.zeros((3, 3))
    thrust_of(control, model.max_thrust, thrust, partials)
    mass_rate = float(control[0]) * model.max_thrust / model.exhaust_velocity
    r, v = start[:3].reshape(3, 1).copy(), start[3:6].reshape(3, 1).copy()
    steps = propagate(
        model, t_a, t_b, float(start[6]), thrust, mass_rate, partials, np.zeros(3), transcription.tolerance,
        r, v, np.zeros((2, 3)), np.zeros((16, 3, STATE_ONLY)),
    )  # fmt: skip
    if steps < 0:
        return np.full(7, np.nan)
    return np.concatenate([r[:, 0], v[:, 0], [start[6] - mass_rate * (t_b - t_a)]])


def target_state(transcription: Transcription, t: float, mass: float) -> Array:
    """Return the state (7,) [LU, VU, MU] of the target at t [TU past departure], with a given mass [MU]."""
    setting = transcription.setting
    moon = np.empty((3, setting.model.bodies.coefficients.shape[2]))
    relative = np.empty((3, setting.target.coefficients.shape[2]))
    states(setting.model.bodies, t, moon)
    states(setting.target, t, relative)
    position, velocity = moon[:2, :3] + relative[:2, :3]
    return np.concatenate([position, velocity, [mass]])


class ReferencePath:
    """The reference of a decision vector as a function of time: states, and the throttle that was flown.

    Boundaries up to the matchpoint are flown forward from the departure, later ones backward from the target.

    Parameters
    ----------
    transcription : Transcription
        The problem, of which only the reference is read.
    x : (n_variables,) array
        Decision vector [days, rad, kg].
    """

    def __init__(self, transcription: Transcription, x: Array) -> None:
        layout = transcription.layout.reference
        self.transcription = transcription
        self.n_segments = layout.n_segments
        self.controls = x[layout.controls].reshape(-1, 3)
        shooting, initial, final = x[layout.offset : layout.offset + 3] / TU_DAYS
        self.segment_time = float(shooting) / layout.n_segments
        self.shooting_start = float(initial)
        self.arrival = float(initial + shooting + final)
        #: (N + 1, 7) states at the segment boundaries [LU, VU, MU].
        self.boundaries = np.empty((layout.n_segments + 1, 7))
        self._fly(layout.matchpoint, x[layout.final_mass] / transcription.scale[layout.final_mass])

    def boundary_time(self, boundary: int) -> float:
        """Return when a segment, counted from 1, begins [TU past departure]."""
        return self.shooting_start + (boundary - 1) * self.segment_time

    def _fly(self, match: int, final_mass: float) -> None:
        start = fly_arc(self.transcription, self.transcription.setting.departure, 0.0, self.shooting_start)
        self.boundaries[0] = start
        for p in range(1, match):
            self.boundaries[p] = self._over(p, self.boundaries[p - 1], p, p + 1)
        end = target_state(self.transcription, self.arrival, final_mass)
        last = self.n_segments
        self.boundaries[last] = fly_arc(self.transcription, end, self.arrival, self.boundary_time(last + 1))
        for p in range(last, match, -1):
            self.boundaries[p - 1] = self._over(p, self.boundaries[p], p + 1, p)

    def _over(self, segment: int, state: Array, start: int, end: int) -> Array:
        times = self.boundary_time(start), self.boundary_time(end)
        return fly_arc(self.transcription, state, *times, self.controls[segment - 1])

    def state(self, t: float) -> Array:
        """Return the state (7,) [LU, VU, MU] at t [TU past departure], between the coasts."""
        segment = self._segment(t)
        if segment < 1:
            return fly_arc(self.transcription, self.boundaries[0], self.shooting_start, t)
        if segment > self.n_segments:
            return fly_arc(
                self.transcription, self.boundaries[-1], self.boundary_time(self.n_segments + 1), t
            )
        control = self.controls[segment - 1]
        return fly_arc(
            self.transcription, self.boundaries[segment - 1], self.boundary_time(segment), t, control
        )

    def mean_throttle(self, t_a: float, t_b: float) -> Array:
        """Return the time average (3,) of the throttle vector [-] from t_a to t_b [TU past departure]."""
        edges = [
            self.boundary_time(p) for p in range(1, self.n_segments + 2) if t_a < self.boundary_time(p) < t_b
        ]
        total = np.zeros(3)
        for start, end in zip([t_a, *edges], [*edges, t_b], strict=True):
            total += (end - start) * self.throttle(0.5 * (start + end))
        return total / (t_b - t_a)

    def throttle(self, t: float) -> Array:
        """Return the throttle vector (3,) [-] at t [TU past departure]."""
        segment = self._segment(t)
        if not 1 <= segment <= self.n_segments:
            return np.zeros(3)
        return np.asarray(throttle_of(self.controls[segment - 1 : segment])[0])

    def _segment(self, t: float) -> int:
        return int(np.floor((t - self.shooting_start) / self.segment_time + 1e-9)) + 1
