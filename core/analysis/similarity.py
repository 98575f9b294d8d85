"""Similarity of solutions: the scaled distance of their references, clusters, and diverse selections.

Two references differ by

    d^2 = (dT_s/W_s)^2 + (dT_i/W_i)^2 + mean over segments of |du|^2

with W the widths of the bounds and u the throttle vectors, so that angles of unlit segments have no weight.
T_f is left out: on a ballistic target it does not change the trajectory.  A solution is mapped
to features once, between which d is the Euclidean distance.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from core.problem import Problem
from core.transcription import layout_of, throttle_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Least distance of distinct solutions: one throttle in fifty differs by a third, or T_s by 4.5 days [-].
DISTINCT = 0.05
#: Rows whose distances are computed at once; only the speed depends on it.
BLOCK = 512


def features(problem: Problem, x: Sequence[float] | Array) -> Array:
    """Return the features of the reference of a solution, whose Euclidean distance is d.

    Parameters
    ----------
    problem : Problem
        P_0, or any P_k of its family: bounds and segments of the reference count.
    x : (n_variables,) array
        Decision vector of a problem of the family [days, rad, kg].

    Returns
    -------
    (2 + 3 N,) array
        T_s and T_i over their widths, throttle vectors over the root of N [-].

    Raises
    ------
    ValueError
        When x is shorter than the reference.
    """
    row: Array = feature_rows(problem, [x])[0]
    return row


def feature_rows(problem: Problem, vectors: Sequence[Sequence[float] | Array]) -> Array:
    """Return the features of many solutions at once.

    Parameters
    ----------
    problem : Problem
        P_0, or any P_k of its family.
    vectors : sequence of (n_variables,) arrays
        Decision vectors of problems of the family, of whatever k [days, rad, kg].

    Returns
    -------
    (n, 2 + 3 N) array
        As `features`, in the order of the vectors [-].

    Raises
    ------
    ValueError
        When a vector is shorter than the reference.
    """
    layout, bounds = layout_of(problem).reference, problem.bounds
    shortest = min((len(x) for x in vectors), default=layout.stop)
    if shortest < layout.stop:
        raise ValueError(f"decision vector: expected {layout.stop} numbers of the reference, got {shortest}")
    references = np.reshape([x[: layout.stop] for x in vectors], (len(vectors), layout.stop))
    throttles = throttle_of(references[:, layout.controls].reshape(-1, 3))
    rows = np.empty((len(vectors), 2 + 3 * layout.n_segments))
    for column, (index, (low, high)) in enumerate(
        ((layout.shooting_time, bounds.shooting_days), (layout.initial_coast, bounds.initial_coast_days))
    ):
        rows[:, column] = references[:, index] / (high - low)
    rows[:, 2:] = throttles.reshape(rows[:, 2:].shape) / np.sqrt(layout.n_segments)
    return rows


def distance(problem: Problem, one: Sequence[float] | Array, other: Sequence[float] | Array) -> float:
    """Return the scaled distance of the references of two solutions [-].

    Parameters
    ----------
    problem : Problem
        P_0, or any P_k of the family.
    one, other : (n_variables,) arrays
        Decision vectors of problems of the family [days, rad, kg].
    """
    return float(np.linalg.norm(features(problem, one) - features(problem, other)))


def clusters(rows: Array, threshold: float = DISTINCT) -> Indices:
    """Return the cluster of each solution, numbered from 0 in order of first appearance.

    A solution joins the first earlier representative within the threshold and else represents a new
    cluster, so the order of the rows counts: give them in order of address.  Eq. (M3).

    Parameters
    ----------
    rows : (n, m) array
        Features, finite [-].
    threshold : float
        Largest distance from a representative [-].

    Returns
    -------
    (n,) array
        Number of the cluster; the first of each number is its representative.

    Raises
    ------
    ValueError
        When the threshold is negative.

    References
    ----------
    docs/method.md, "Metrics".
    """
    if not threshold >= 0.0:
        raise ValueError(f"threshold: expected a distance of at least 0, got {threshold}")
    found = _Representatives(rows, threshold)
    for start in range(0, len(rows), BLOCK):
        found.add(np.arange(start, min(start + BLOCK, len(rows))))
    return found.clusters


def most_diverse(rows: Array, n: int) -> Indices:
    """Return n diverse solutions: the first, then repeatedly the one farthest from all chosen.

    The time is proportional to n times the number of rows.  Ties go to the first row.

    Parameters
    ----------
    rows : (n_rows, m) array
        Features in order of address, finite [-].
    n : int
        How many to choose; all of them if there are fewer [-].

    Returns
    -------
    (min(n, n_rows),) array
        Indices of rows in the order in which they were chosen.

    Raises
    ------
    ValueError
        When n is negative.

    References
    ----------
    Gonzalez, Theoretical Computer Science 38 (1985), 293-306: farthest-point clustering.
    """
    if n < 0:
        raise ValueError(f"number of solutions: expected at least 0, got {n}")
    chosen = np.empty(min(n, len(rows)), dtype=np.int64)
    nearest = np.full(len(rows), np.inf)
    for i in range(len(chosen)):
        chosen[i] = np.argmax(nearest)
        nearest = np.minimum(nearest, np.sum((rows - rows[chosen[i]]) ** 2, axis=1))
        # Below every distance, so that a duplicate of a chosen one comes before the chosen one itself.
        nearest[chosen[: i + 1]] = -1.0
    return chosen


class _Representatives:
    """The representatives found so far, in cells of the feature with the largest spread.

    A solution and its representative are at most one cell apart, so that other cells need no search.
    """

    def __init__(self, rows: Array, threshold: float) -> None:
        self.rows, self.threshold = rows, threshold
        self.squares = np.einsum("ij,ij->i", rows, rows)
        # Bounds the rounding of |a|^2 + |b|^2 - 2ab, which only decides pairs that are clearly near or far.
        self.slack = 8.0 * (rows.shape[1] + 4) * np.finfo(float).eps * self.squares.max(initial=0.0)
        self.cells = _cells(rows, threshold)
        self.by_cell: dict[int, list[int]] = {}
        self.clusters = np.full(len(rows), -1, dtype=np.int64)
        self.n_clusters = 0

    def add(self, block: Indices) -> None:
        """Assign the next rows: to existing representatives, the rest among each other."""
        for cell in np.unique(self.cells[block]):
            members = block[self.cells[block] == cell]
            known = np.sort([one for near in (-1, 0, 1) for one in self.by_cell.get(int(cell) + near, ())])
            if len(known):
                for row, first in self._first_within(members, known.astype(np.int64)):
                    self.clusters[row] = self.clusters[first]
        left = block[self.clusters[block] < 0]
        is_near = self._is_within(left, left)
        for i, row in enumerate(left):
            if self.clusters[row] < 0:
                members = left[i:][is_near[i, i:] & (self.clusters[left[i:]] < 0)]
                self.clusters[members] = self.clusters[row] = self.n_clusters
                self.n_clusters += 1
                self.by_cell.setdefault(int(self.cells[row]), []).append(int(row))

    def _first_within(self, members: Indices, known: Indices) -> Iterator[tuple[int, int]]:
        is_near = self._is_within(members, known)
        for i in np.flatnonzero(is_near.any(axis=1)):
            yield members[i], known[np.argmax(is_near[i])]

    def _is_within(self, some: Indices, others: Indices) -> NDArray[np.bool_]:
        squared = (
            self.squares[some, None] + self.squares[others] - 2.0 * self.rows[some] @ self.rows[others].T
        )
        limit = self.threshold**2
        is_near: NDArray[np.bool_] = squared <= limit
        for i, j in np.argwhere(np.abs(squared - limit) <= self.slack):
            is_near[i, j] = np.linalg.norm(self.rows[some[i]] - self.rows[others[j]]) <= self.threshold
        return is_near


def _cells(rows: Array, threshold: float) -> Indices:
    """Return the cell of each row; cells are slightly wider than the threshold, against rounding."""
    if not len(rows):
        return np.empty(0, dtype=np.int64)
    key = rows[:, np.argmax(np.ptp(rows, axis=0))]
    spread = float(np.ptp(key))
    width = max(threshold * (1.0 + 1e-9), 1e-6 * spread) or 1.0
    return np.asarray((key - key.min()) // width, dtype=np.int64)
