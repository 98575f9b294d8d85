"""The layout of the decision vector: the only index arithmetic on it.

The paper layout x lists, for the reference and then for each realization in order of outage,
(T_s, T_i, T_f, u_1 .. u_N, m_f).  The lifted vector z holds the same entries in canonical units, followed
by seven numbers (r, v, m) per shooting node.  `Guess` is a start vector with the states of its trajectories
where a mapping knows them; `Start` is the state in which a transfer starts after an outage has begun.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.problem import Outage, Problem
from core.world import EARTH, Units, world_of

Array = NDArray[np.float64]

#: Numbers of one control and of one state.
CONTROL, STATE = 3, 7


@dataclass(frozen=True, slots=True)
class TrajectoryLayout:
    """The slice of the decision vector of one trajectory."""

    #: Index of its first variable.
    offset: int
    #: Number of its segments.
    n_segments: int
    #: The outage before it, None for the reference.
    outage: Outage | None

    @property
    def shooting_time(self) -> int:
        """Index of T_s."""
        return self.offset

    @property
    def initial_coast(self) -> int:
        """Index of T_i."""
        return self.offset + 1

    @property
    def final_coast(self) -> int:
        """Index of T_f."""
        return self.offset + 2

    def control(self, segment: int) -> int:
        """Return the index of the throttle of a segment, counted from 1."""
        return self.offset + 3 + CONTROL * (segment - 1)

    @property
    def controls(self) -> slice:
        """All controls."""
        return slice(self.control(1), self.final_mass)

    @property
    def final_mass(self) -> int:
        """Index of m_f."""
        return self.offset + 3 + CONTROL * self.n_segments

    @property
    def stop(self) -> int:
        """One past the last variable."""
        return self.final_mass + 1

    @property
    def matchpoint(self) -> int:
        """Boundary where the halves meet: the start of this segment, counted from 1."""
        return self.n_segments // 2 + 1


@dataclass(frozen=True, slots=True)
class Layout:
    """The slices of the trajectories of a problem, the reference first."""

    trajectories: tuple[TrajectoryLayout, ...]
    units: Units = EARTH.units

    @property
    def n_variables(self) -> int:
        """Length of x."""
        return self.trajectories[-1].stop

    @property
    def reference(self) -> TrajectoryLayout:
        """The slice of the reference."""
        return self.trajectories[0]

    def scale(self) -> Array:
        """Return the (n_variables,) factors from canonical units to those of x (days, kg, rad)."""
        factors = np.ones(self.n_variables)
        for trajectory in self.trajectories:
            factors[trajectory.offset : trajectory.offset + 3] = self.units.tu_days
            factors[trajectory.final_mass] = self.units.mu_kg
        return factors

    def bounds(self, problem: Problem, start_mass_kg: float) -> tuple[Array, Array]:
        """Return the bounds of x, docs/method.md section 4, in the units of x."""
        lower, upper = self.sampling_box(problem, start_mass_kg)
        lower[[trajectory.final_mass for trajectory in self.trajectories]] = problem.least_final_mass_kg
        return lower, upper

    def sampling_box(self, problem: Problem, start_mass_kg: float) -> tuple[Array, Array]:
        """Return the box from which guesses are drawn and which scales hops, in the units of x.

        The bounds lie in it: here the dry mass does not count, so that a search draws the same guesses
        whatever the dry mass is.
        """
        lower, upper = np.empty(self.n_variables), np.empty(self.n_variables)
        box = problem.bounds
        for trajectory in self.trajectories:
            missed = trajectory.outage.segment if trajectory.outage else 0
            share = (problem.n_segments - missed) / problem.n_segments
            shooting = share * np.array(box.shooting_days)
            times = np.stack([shooting, box.initial_coast_days, box.final_coast_days])
            control_low = [box.throttle[0], -np.pi, -np.pi / 2]
            control_high = [box.throttle[1], np.pi, np.pi / 2]
            n = trajectory.n_segments
            lower[trajectory.offset : trajectory.stop] = [
                *times[:, 0],
                *control_low * n,
                box.min_final_mass_kg,
            ]
            upper[trajectory.offset : trajectory.stop] = [*times[:, 1], *control_high * n, start_mass_kg]
        return lower, upper


def layout_of(problem: Problem) -> Layout:
    """Return the layout of a problem's decision vector."""
    trajectories = [TrajectoryLayout(0, problem.n_segments, None)]
    for outage in problem.outages:
        left = problem.n_segments - outage.segment
        n_segments = left if problem.segmentation == "adaptive" else problem.n_segments
        trajectories.append(TrajectoryLayout(trajectories[-1].stop, n_segments, outage))
    return Layout(tuple(trajectories), world_of(problem).units)


def checked_vector(layout: Layout, x: object) -> Array:
    """Return x as a float array, or raise ValueError with the expected and the given shape."""
    try:
        vector = np.asarray(x, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"decision vector: expected numbers, got {type(x).__name__}: {error}") from error
    if vector.shape != (layout.n_variables,):
        raise ValueError(
            f"decision vector: expected shape ({layout.n_variables},) for "
            f"{layout.reference.n_segments} segments, k = {len(layout.trajectories) - 1}, got {vector.shape}"
        )
    if not np.all(np.isfinite(vector)):
        raise ValueError(
            f"decision vector: expected finite numbers, got {np.sum(~np.isfinite(vector))} that are not"
        )
    return vector


@dataclass(frozen=True, slots=True, eq=False)
class Guess:
    """A decision vector; the states, if any, start the shooting nodes and are never part of the solution."""

    #: (n_variables,) in the paper layout [days, rad, kg].
    x: Array
    #: (N_w + 1, 7) states at the segment boundaries of each trajectory [LU, VU, MU]; None, or NaN for a
    #: boundary: propagate x.
    states: tuple[Array | None, ...] | None = None

    def __len__(self) -> int:
        """Return the length of x."""
        return len(self.x)

    def __getitem__(self, index: Any) -> Any:
        """Return entries of x."""
        return self.x[index]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """Return x, so that a guess can be used as a decision vector."""
        return np.array(self.x, dtype=dtype, copy=copy)


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """A state during a transfer, and the problem of that transfer."""

    #: Its bodies, its target and its departure epoch stay; its bounds, segments and outages play no part.
    problem: Problem
    #: When the transfer begins [TU past departure].
    time: float
    #: (7,) state there [LU, VU, MU].
    state: Array
