"""Single arcs, states and whole paths, for building guesses."""

from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from core.dynamics import STATE as STATE_ONLY
from core.dynamics import propagate
from core.ephemeris import states
from core.transcription.control import throttle_of, thrust_of
from core.transcription.layout import TrajectoryLayout
from core.transcription.transcription import Transcription

Array = NDArray[np.float64]
_COAST = np.zeros(3)


def fly_arc(
    transcription: Transcription, start: Array, t_a: float, t_b: float, control: Array = _COAST
) -> Array:
    """Return the state at the end of one arc, NaN where it cannot be propagated.

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


class FlownPath:
    """One trajectory of a decision vector as a function of time: states and throttle.

    Boundaries up to the matchpoint are flown forward from the start, later ones backward from the target.

    Parameters
    ----------
    transcription : Transcription
        The problem.
    x : (n_variables,) array
        Decision vector [days, rad, kg].
    layout : TrajectoryLayout
        Where the trajectory stands in x.
    start : float
        When its own coast begins: at departure, or as its outage ends [TU past departure].
    """

    def __init__(
        self, transcription: Transcription, x: Array, layout: TrajectoryLayout, start: float
    ) -> None:
        self.transcription, self.tu_days = transcription, transcription.world.units.tu_days
        self.n_segments, self.matchpoint = layout.n_segments, layout.matchpoint
        self.controls = x[layout.controls].reshape(-1, 3)
        shooting, initial, self.final_coast = x[layout.offset : layout.offset + 3] / self.tu_days
        self.segment_time = float(shooting) / layout.n_segments
        self.shooting_start = start + float(initial)
        self.arrival = float(self.shooting_start + shooting + self.final_coast)
        self.final_mass = x[layout.final_mass] / transcription.scale[layout.final_mass]

    def boundary_time(self, boundary: int) -> float:
        """Return when a segment, counted from 1, begins [TU past departure]."""
        return self.shooting_start + (boundary - 1) * self.segment_time

    @property
    def edges(self) -> list[float]:
        """Times at which the throttle may change, the last is the end of the last segment."""
        return [self.boundary_time(p) for p in range(1, self.n_segments + 2)]

    @cached_property
    def boundaries(self) -> Array:
        """(N + 1, 7) states at the segment boundaries [LU, VU, MU]."""
        flown, last = np.empty((self.n_segments + 1, 7)), self.n_segments
        flown[0] = self._shooting_state()
        for p in range(1, self.matchpoint):
            flown[p] = self._over(p, flown[p - 1], p, p + 1)
        end = target_state(self.transcription, self.arrival, self.final_mass)
        flown[last] = fly_arc(self.transcription, end, self.arrival, self.boundary_time(last + 1))
        for p in range(last, self.matchpoint, -1):
            flown[p - 1] = self._over(p, flown[p], p + 1, p)
        return flown

    def _shooting_state(self) -> Array:
        """Return the state (7,) at which the first segment begins [LU, VU, MU]."""
        raise NotImplementedError

    def _over(self, segment: int, state: Array, start: int, end: int) -> Array:
        times = self.boundary_time(start), self.boundary_time(end)
        return fly_arc(self.transcription, state, *times, self.controls[segment - 1])

    def state(self, t: float) -> Array:
        """Return the state (7,) [LU, VU, MU] at t [TU past departure], between the coasts."""
        boundary = min(max(self._segment(t), 1), self.n_segments + 1)
        begin, state = self.boundary_time(boundary), self.boundaries[boundary - 1]
        return fly_arc(self.transcription, state, begin, t, self.control(t))

    def control(self, t: float) -> Array:
        """Return the control (3,) at t [TU past departure]: throttle [-] and angles [rad]."""
        segment = self._segment(t)
        return self.controls[segment - 1] if 1 <= segment <= self.n_segments else _COAST

    def throttle(self, t: float) -> Array:
        """Return the throttle vector (3,) [-] at t [TU past departure]."""
        return np.asarray(throttle_of(self.control(t)[None, :])[0])

    def mean_throttle(self, t_a: float, t_b: float) -> Array:
        """Return the time average (3,) of the throttle vector [-] from t_a to t_b [TU past departure]."""
        cuts = [t_a, *(edge for edge in self.edges if t_a < edge < t_b), t_b]
        total = np.zeros(3)
        for start, end in pairwise(cuts):
            total += (end - start) * self.throttle(0.5 * (start + end))
        return total / (t_b - t_a)

    def _segment(self, t: float) -> int:
        return int(np.floor((t - self.shooting_start) / self.segment_time + 1e-9)) + 1


class ReferencePath(FlownPath):
    """The path of the reference of a decision vector.

    Parameters
    ----------
    transcription : Transcription
        The problem, of which only the reference is read.
    x : (n_variables,) array
        Decision vector [days, rad, kg].
    """

    def __init__(self, transcription: Transcription, x: Array) -> None:
        super().__init__(transcription, x, transcription.layout.reference, 0.0)

    def _shooting_state(self) -> Array:
        return fly_arc(self.transcription, self.transcription.setting.departure, 0.0, self.shooting_start)


class RealizationPath(FlownPath):
    """The path under one outage: the reference up to it, both coasts, then its own segments.

    Parameters
    ----------
    transcription : Transcription
        The problem.
    x : (n_variables,) array
        Decision vector [days, rad, kg].
    number : int
        Which realization, from 1 in order of outage [-].
    """

    def __init__(self, transcription: Transcription, x: Array, number: int) -> None:
        layout = transcription.layout.trajectories[number]
        outage = layout.outage
        assert outage is not None
        self.reference, self.segment = ReferencePath(transcription, x), outage.segment
        #: When the outage begins [TU past departure].
        self.outage_start = self.reference.boundary_time(outage.segment)
        super().__init__(
            transcription, x, layout, self.outage_start + outage.duration_days / self.reference.tu_days
        )

    def _shooting_state(self) -> Array:
        start = self.reference.boundaries[self.segment - 1]
        return fly_arc(self.transcription, start, self.outage_start, self.shooting_start)

    @property
    def edges(self) -> list[float]:
        """Times at which the throttle may change, those of the reference up to the outage included."""
        return [*self.reference.edges[: self.segment], *super().edges]

    def state(self, t: float) -> Array:
        """Return the state (7,) [LU, VU, MU] at t [TU past departure]."""
        return self.reference.state(t) if self._is_before(t) else super().state(t)

    def control(self, t: float) -> Array:
        """Return the control (3,) at t [TU past departure]: throttle [-] and angles [rad]."""
        return self.reference.control(t) if self._is_before(t) else super().control(t)

    def _is_before(self, t: float) -> bool:
        """Return whether t [TU past departure] lies before the outage."""
        return t < self.outage_start - 1e-9 * self.reference.segment_time
