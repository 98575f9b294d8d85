"""Realizations placed on the paths of a seed at the same epochs, and a seed on a finer mesh.

The forms `aligned` and `continued` of docs/method.md, section 8.  Mesh refinement is exact: each control is
repeated, so the thrust is the same function of time, and any gain is due to the solver; eqs. S26 and S27.
"""

from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from core.problem import Outage, Problem
from core.search.settings import check_refinement
from core.transcription import (
    FlownPath,
    Guess,
    OutageProfile,
    RealizationPath,
    ReferencePath,
    TrajectoryLayout,
    Transcription,
    checked_vector,
    control_of,
    layout_of,
    transcribe,
)
from core.units import TU_DAYS

Array = NDArray[np.float64]

#: Two epochs closer than this fraction of a segment count as one [-].
SAME = 1e-9


class Seed:
    """A solution of P_k' and its propagated paths.

    Parameters
    ----------
    problem : Problem
        P_k'.
    x : (n_variables,) array
        The solution [days, rad, kg].

    Raises
    ------
    ValueError
        When x is no vector of P_k'.
    """

    def __init__(self, problem: Problem, x: Array) -> None:
        self.transcription = transcribe(problem)
        self.layout = self.transcription.layout
        self.x = checked_vector(self.layout, x)
        self._paths: dict[int, FlownPath] = {}

    @cached_property
    def reference(self) -> ReferencePath:
        """The path without an outage."""
        return ReferencePath(self.transcription, self.x)

    def path(self, source: int) -> FlownPath:
        """Return the path of a realization, counted from 1, or for 0 of the reference."""
        if source == 0:
            return self.reference
        if source not in self._paths:
            self._paths[source] = RealizationPath(self.transcription, self.x, source)
        return self._paths[source]

    def part(self, source: int) -> Array:
        """Return the variables of a trajectory [days, rad, kg]."""
        trajectory = self.layout.trajectories[source]
        return self.x[trajectory.offset : trajectory.stop]


def aligned(
    target: Transcription, trajectory: TrajectoryLayout, seed: Seed, source: int
) -> tuple[Array, Array]:
    """Return a realization that rejoins a path of the seed at the first edge after its outage.

    Parameters
    ----------
    target : Transcription
        P_k.
    trajectory : TrajectoryLayout
        Where the realization stands in it.
    seed : Seed
        The seed.
    source : int
        The path: 0 for the reference, or the number of a realization [-].

    Returns
    -------
    (n,) array, (N_w + 1, 7) array
        Its variables [days, rad, kg] and the path at its segment boundaries [LU, VU, MU].

    References
    ----------
    docs/method.md, eqs. S4 and S24.
    """
    path, old = seed.path(source), seed.layout.trajectories[source]
    if old.outage == trajectory.outage:
        return seed.part(source), path.boundaries
    assert trajectory.outage is not None
    n, box = trajectory.n_segments, _box(target, trajectory)
    over, shooting, initial = _times(path, _end(seed, trajectory.outage), box)
    start = over + initial
    edges = start + shooting * np.arange(n + 1) / n
    times = np.array([shooting * TU_DAYS, initial * TU_DAYS, seed.x[old.final_coast]])
    x = np.concatenate([times, _controls(path, edges).ravel(), [seed.x[old.final_mass]]])
    return np.clip(x, *box), np.array([path.state(t) for t in edges])


def thrust_profile(seed: Seed, outage: Outage, source: int, share: float) -> OutageProfile:
    """Return the thrust profile of a path of the seed during an outage, scaled by a fraction.

    Parameters
    ----------
    seed : Seed
        The seed.
    outage : Outage
        The outage.
    source : int
        The path: 0 for the reference, or the number of a realization [-].
    share : float
        Between 0 and 1 [-].

    References
    ----------
    docs/method.md, eq. S5.
    """
    path, begin = seed.path(source), seed.reference.boundary_time(outage.segment)
    slack, end = SAME * path.segment_time, _end(seed, outage)
    # The solver could shrink an arc that began after the end to zero or negative length.
    inside = [edge for edge in path.edges if begin + slack < edge < end - slack]
    held = []
    for start, stop in pairwise([begin, *inside, end]):
        throttle, *angles = (float(number) for number in path.control(0.5 * (start + stop)))
        held.append((stop - start, (share * throttle, angles[0], angles[1])))
    return tuple(held)


def _end(seed: Seed, outage: Outage) -> float:
    """Return when an outage ends [TU past departure]."""
    return seed.reference.boundary_time(outage.segment) + outage.duration_days / TU_DAYS


def _box(target: Transcription, trajectory: TrajectoryLayout) -> tuple[Array, Array]:
    """Return the bounds of a trajectory's variables [days, rad, kg]."""
    lower, upper = target.bounds
    return lower[trajectory.offset : trajectory.stop], upper[trajectory.offset : trajectory.stop]


def _times(path: FlownPath, over: float, box: tuple[Array, Array]) -> tuple[float, float, float]:
    """Return the end of the outage, T_s and T_i [TU]: from an edge of the path to its end, inside the box."""
    least, most = (side[:3] / TU_DAYS for side in box)
    h, end = path.segment_time, path.edges[-1]
    # The last edge is the end, and at least one segment must remain.
    edges = (edge for edge in path.edges[:-1] if edge >= over - SAME * h)
    start = max(next(edges, over), over)
    # The remaining time may exceed the bounds: then the coast is longer.
    initial = np.clip(max(start, end - most[0] - SAME * h) - over, least[1], most[1])
    shooting = np.clip(max(end - over - initial, h), least[0], most[0])
    return over, float(shooting), float(initial)


def _controls(path: FlownPath, edges: Array) -> Array:
    """Return the controls (n, 3) of segments between edges, with the path's mean thrust vectors."""
    n = len(edges) - 1
    first, slack = path.n_segments - n + 1, SAME * path.segment_time
    # Equal grids are copied: averaging would lose the angles of unlit segments.
    if first >= 1 and np.allclose(edges[[0, -1]], [path.boundary_time(first), path.edges[-1]], 0, slack):
        return path.controls[first - 1 :]
    return control_of(np.array([path.mean_throttle(a, b) for a, b in pairwise(edges)]))


def refined_guess(problem_from: Problem, x: Array, problem_to: Problem) -> Guess:
    """Return the trajectories of a seed as a guess for the same problem on a finer mesh.

    A realization of N - n segments becomes one of m (N - n) + m - 1, since the segment that an outage misses
    is shorter too.  The m - 1 extra segments stay unlit: they lie in the initial coast as far as that is
    long enough, and else in the final one, on a ballistic target without an effect.

    Parameters
    ----------
    problem_from : Problem
        Problem of the seed.
    x : (n_variables,) array
        The seed [days, rad, kg].
    problem_to : Problem
        The same with m times the segments, see `refined_problem`.

    Returns
    -------
    Guess
        In the paper layout of `problem_to`.

    Raises
    ------
    ValueError
        When the problems differ otherwise, or x is no vector of the seed's problem.

    References
    ----------
    docs/method.md, eqs. S26 and S27.
    """
    factor = check_refinement(problem_from, problem_to)
    seed = checked_vector(layout_of(problem_from), x)
    pairs = zip(layout_of(problem_from).trajectories, layout_of(problem_to).trajectories, strict=True)
    return Guess(
        np.concatenate([_subdivide(seed[old.offset : old.stop], old, new, factor) for old, new in pairs])
    )


def _subdivide(part: Array, old: TrajectoryLayout, new: TrajectoryLayout, factor: int) -> Array:
    """Return the variables of a trajectory with each segment divided into `factor`, and unlit ones added."""
    shooting, initial, final = part[:3]
    h = shooting / (factor * old.n_segments)
    extra = new.n_segments - factor * old.n_segments
    before = min(extra, int(initial / h + SAME)) if h > 0.0 else extra
    after = extra - before
    controls = np.repeat(part[3:-1].reshape(-1, 3), factor, axis=0)
    unlit = np.zeros((extra, 3))
    times = [shooting + extra * h, max(initial - before * h, 0.0), max(final - after * h, 0.0)]
    return np.concatenate([times, np.vstack([unlit[:before], controls, unlit[before:]]).ravel(), part[-1:]])
