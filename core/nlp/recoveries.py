"""A recovery as a transfer of its own: it starts where the reference is when thrust stops.

With the reference as it is, each recovery is an independent problem without outages, whose initial coast
contains the outage.  docs/missed-thrust.md.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from core.problem import Outage, Problem
from core.transcription import (
    FlownPath,
    ReferencePath,
    Start,
    TrajectoryLayout,
    Transcription,
    control_of,
    transcribe,
)

Array = NDArray[np.float64]

#: Two epochs closer than this fraction of a segment count as one [-].
SAME = 1e-9


def recovery(transcription: Transcription, path: ReferencePath, own: TrajectoryLayout) -> Transcription:
    """Return a realization's recovery as an independent transfer, whose initial coast contains the outage.

    Parameters
    ----------
    transcription : Transcription
        P_k.
    path : ReferencePath
        Its reference.
    own : TrajectoryLayout
        Where the realization stands in P_k.
    """
    problem, outage = transcription.problem, _outage(own)
    left = _remaining_problem(problem, outage, own.n_segments)
    state = path.boundaries[outage.segment - 1]
    start = Start(problem, path.boundary_time(outage.segment), state)
    n_legs = max(2, round(transcription.n_legs * own.n_segments / problem.n_segments))
    return transcribe(left, n_legs, transcription.tolerance, start=start)


def _remaining_problem(problem: Problem, outage: Outage, n_segments: int) -> Problem:
    """Return the problem that remains when an outage begins, with the bounds of a realization of P_k."""
    box, share = problem.bounds, (problem.n_segments - outage.segment) / problem.n_segments
    shooting = tuple(share * side for side in box.shooting_days)
    initial = tuple(outage.duration_days + side for side in box.initial_coast_days)
    bounds = box.model_copy(update={"shooting_days": shooting, "initial_coast_days": initial})
    return problem.model_copy(update={"n_segments": n_segments, "bounds": bounds, "outages": ()})


def to_recovery(own: TrajectoryLayout, part: Array) -> Array:
    """Return a realization's variables as those of its recovery: the initial coast includes the outage."""
    x = part.copy()
    x[own.initial_coast - own.offset] += _outage(own).duration_days
    return x


def to_realization(transcription: Transcription, own: TrajectoryLayout, x: Array) -> Array:
    """Return a recovery's variables as those of its realization."""
    part = x.copy()
    part[own.initial_coast - own.offset] -= _outage(own).duration_days
    # Rounding may make the difference slightly negative.
    return np.clip(part, *box_of(transcription, own))


def _outage(own: TrajectoryLayout) -> Outage:
    assert own.outage is not None
    return own.outage


def rejoin(
    target: Transcription, own: TrajectoryLayout, path: FlownPath, over: float, rest: tuple[float, float]
) -> tuple[Array, Array]:
    """Return a realization that rejoins a path at the first edge after its outage.

    Parameters
    ----------
    target : Transcription
        P_k.
    own : TrajectoryLayout
        Where the realization stands in it.
    path : FlownPath
        The path.
    over : float
        When the outage ends [TU past departure].
    rest : tuple of float
        Final coast [days] and final mass [kg] of the path.

    Returns
    -------
    (n,) array, (N_w + 1, 7) array
        Its variables [days, rad, kg] and the path at its segment boundaries [LU, VU, MU].

    References
    ----------
    docs/method.md, eqs. S4 and S24.
    """
    n, box = own.n_segments, box_of(target, own)
    shooting, initial = _times(path, over, box)
    edges = over + initial + shooting * np.arange(n + 1) / n
    times = np.array([shooting * path.tu_days, initial * path.tu_days, rest[0]])
    x = np.concatenate([times, _controls(path, edges).ravel(), rest[1:]])
    return np.clip(x, *box), np.array([path.state(t) for t in edges])


def box_of(target: Transcription, own: TrajectoryLayout) -> tuple[Array, Array]:
    """Return the bounds of a trajectory's variables [days, rad, kg]."""
    lower, upper = target.bounds
    return lower[own.offset : own.stop], upper[own.offset : own.stop]


def _times(path: FlownPath, over: float, box: tuple[Array, Array]) -> tuple[float, float]:
    """Return T_s and T_i [TU]: from an edge of the path after an outage to its end, inside the box."""
    least, most = (side[:3] / path.tu_days for side in box)
    h, end = path.segment_time, path.edges[-1]
    # The last edge is the end, and at least one segment must remain.
    edges = (edge for edge in path.edges[:-1] if edge >= over - SAME * h)
    start = max(next(edges, over), over)
    # The remaining time may exceed the bounds: then the coast is longer.
    initial = np.clip(max(start, end - most[0] - SAME * h) - over, least[1], most[1])
    shooting = np.clip(max(end - over - initial, h), least[0], most[0])
    return float(shooting), float(initial)


def _controls(path: FlownPath, edges: Array) -> Array:
    """Return the controls (n, 3) of segments between edges, with the path's mean thrust vectors."""
    n = len(edges) - 1
    first, slack = path.n_segments - n + 1, SAME * path.segment_time
    # Equal grids are copied: averaging would lose the angles of unlit segments.
    if first >= 1 and np.allclose(edges[[0, -1]], [path.boundary_time(first), path.edges[-1]], 0, slack):
        return path.controls[first - 1 :]
    return control_of(np.array([path.mean_throttle(a, b) for a, b in pairwise(edges)]))
