"""The lifted problem with throttle vectors for controls: what the descent moves, and how far it may move.

z is canonical.  A throttle vector has no singular direction where a segment coasts, and its length may pass
1 on the way to a solution.
"""

import numpy as np
from numpy.typing import NDArray

from core.transcription import STATE, Guess, TrajectoryLayout, Transcription, control_of, throttle_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

# Lengths by which a step is measured [LU, VU, MU, TU], measured: nodes that move ten times as far are lost.
_NODE_POSITION, _NODE_VELOCITY, _MASS, _TIME = 0.03, 0.1, 0.1, 0.1
# Kept between a time and its bound, so that rounding does not pass it [TU].
_MARGIN = 1e-6
_LEAST_MASS = 1e-3


class ThrustVectors:
    """Indices, scales and evaluations of one transcription's problem in z.

    Parameters
    ----------
    transcription : Transcription
        The problem.
    is_reference_fixed : bool
        Whether only the realizations may move, and only their defects count.
    """

    def __init__(self, transcription: Transcription, is_reference_fixed: bool = False) -> None:
        self.transcription = transcription
        structure, layout = transcription.vectors, transcription.layout
        self.n_segments = layout.reference.n_segments
        trajectories = layout.trajectories
        #: (n_controls, 3) places of the throttle vectors, the reference's first; (3 (k + 1),) of the times.
        self.controls: Indices = np.concatenate(
            [np.arange(t.controls.start, t.controls.stop) for t in trajectories]
        ).reshape(-1, 3)
        self.times: Indices = np.concatenate([np.arange(t.offset, t.offset + 3) for t in trajectories])
        #: (n_others,) places of all that is no control.
        self.others: Indices = np.setdiff1d(np.arange(structure.n_variables), self.controls.ravel())
        #: (k + 1,) trajectories that may move.
        self.is_free = [not is_reference_fixed] + (len(trajectories) - 1) * [True]
        free = self._free()
        #: (n_controls,) and (n_others,) what may move.
        self.free_controls: Mask = free[self.controls[:, 0]]
        self.free_others: Mask = free[self.others]
        #: (n_variables,) lengths by which steps are measured.
        self.scale = node_scales(transcription)
        touched = np.zeros(STATE * len(structure.plan.block_plus), dtype=bool)
        touched[structure.rows[free[structure.columns]]] = True
        #: (n_defects,) rows of the defects that what may move acts on.
        self.rows: Indices = np.flatnonzero(touched)
        self.n_defects = len(self.rows)
        # That of the reference is left to the phase that saves propellant, which realizations do not have.
        masses = np.array([t.final_mass for t in trajectories[1:]], dtype=np.int64)
        lower, upper = (side / transcription.scale for side in transcription.bounds)
        lower[self.times] += _MARGIN
        upper[self.times] -= _MARGIN
        # What is flown from the departure has no more mass than that.
        upper[masses] = np.inf
        bounded = np.sort(np.concatenate([self.times, masses]))
        #: Places of the times [TU] and of realizations' final masses [MU] that may move, and how far.
        self.bounded: Indices = bounded[free[bounded]]
        self.lowest, self.highest = lower[self.bounded], upper[self.bounded]
        #: Which of these are shooting times.
        self.is_shooting: Mask = np.isin(self.bounded, [t.shooting_time for t in trajectories])
        #: Bounds of the throttles [-].
        self.least, self.most = transcription.problem.bounds.throttle
        setting = transcription.setting
        #: Mass flow at full throttle [MU/TU].
        self.flow = setting.model.max_thrust / setting.model.exhaust_velocity

    def start(self, guess: Array | Guess) -> Array:
        """Return z of a guess; where it has no states, final masses are what its throttles leave."""
        z = self.transcription.lift(guess)
        z[self.controls] = throttle_of(z[self.controls])
        states = guess.states if isinstance(guess, Guess) else None
        for index in range(len(self.transcription.layout.trajectories)):
            if self.is_free[index] and (states is None or states[index] is None):
                self._balance_mass(z, index)
        self.transcription.fill_nodes(self.transcription.vectors, z)
        return z

    def lengthened(self, start: Array) -> Array:
        """Return a start with shooting times halfway to their latest, flown afresh with its controls."""
        z = start.copy()
        places = self.bounded[self.is_shooting]
        z[places] += 0.5 * (self.highest[self.is_shooting] - z[places])
        for index in np.flatnonzero(self.is_free):
            self._balance_mass(z, int(index))
        self.transcription.fill_nodes(self.transcription.vectors, z)
        return z

    def decision(self, z: Array) -> Array:
        """Return x of z [days, rad, kg], inside its box."""
        x = z[: self.transcription.n_variables].copy()
        x[self.controls] = control_of(z[self.controls])
        lower, upper = self.transcription.bounds
        return np.clip(x * self.transcription.scale, lower, upper)

    def defects(self, z: Array) -> Array:
        """Return the canonical defects (n_defects,), NaN where z cannot be flown."""
        return self.transcription.evaluate(self.transcription.vectors, z, with_partials=False)[0][self.rows]

    def linearize(self, z: Array) -> tuple[Array, Array]:
        """Return the defects and their dense Jacobian (n_defects, n_variables)."""
        structure = self.transcription.vectors
        defects, values = self.transcription.evaluate(structure, z, with_partials=True)
        jacobian = np.zeros((len(defects), len(z)))
        jacobian[structure.rows, structure.columns] = values
        return defects[self.rows], jacobian[self.rows]

    def throttles(self, z: Array) -> Array:
        """Return the lengths (n_controls,) of the throttle vectors."""
        return np.asarray(np.sqrt((z[self.controls] ** 2).sum(axis=1)))

    def inside(self, z: Array) -> Array:
        """Return z with what is bounded in its bounds; lengths of throttle vectors are the cost's affair."""
        z[self.bounded] = np.clip(z[self.bounded], self.lowest, self.highest)
        return z

    def _free(self) -> Mask:
        structure = self.transcription.vectors
        free = np.ones(structure.n_variables, dtype=bool)
        for index, trajectory in enumerate(self.transcription.layout.trajectories):
            free[trajectory.offset : trajectory.stop] = self.is_free[index]
        for (index, _), place in structure.nodes.items():
            free[place : place + STATE] = self.is_free[index]
        free[self.transcription.idle_coasts] = False
        return free

    def _balance_mass(self, z: Array, index: int) -> None:
        """Set a final mass to what the throttles leave, and forget the nodes; first put the times inside."""
        self.inside(z)
        transcription = self.transcription
        trajectory, reference = transcription.layout.trajectories[index], transcription.layout.reference
        mass = float(transcription.setting.departure[6])
        if trajectory.outage is not None:
            mass -= self._spent(z, reference, trajectory.outage.segment - 1)
        mass -= self._spent(z, trajectory, trajectory.n_segments)
        z[trajectory.final_mass] = max(mass, _LEAST_MASS)
        for (of, _), place in transcription.vectors.nodes.items():
            if of == index:
                z[place : place + STATE] = np.nan

    def _spent(self, z: Array, trajectory: TrajectoryLayout, n_segments: int) -> float:
        """Return the mass that a trajectory's first segments burn [MU]."""
        vectors = z[trajectory.controls].reshape(-1, 3)[:n_segments]
        share = z[trajectory.shooting_time] / trajectory.n_segments
        return float(self.flow * share * np.sqrt((vectors**2).sum(axis=1)).sum())


def node_scales(transcription: Transcription) -> Array:
    """Return the lengths (n_variables,) by which steps of a lifted vector are measured; controls have 1."""
    structure, layout = transcription.lifted, transcription.layout
    scale = np.ones(structure.n_variables)
    for trajectory in layout.trajectories:
        scale[trajectory.offset : trajectory.offset + 3] = _TIME
        scale[trajectory.final_mass] = _MASS
    for place in structure.nodes.values():
        scale[place : place + STATE] = [_NODE_POSITION] * 3 + [_NODE_VELOCITY] * 3 + [_MASS]
    return scale
