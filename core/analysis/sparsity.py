"""Number of structural entries of the Jacobian of P_k: by formula, and from the transcription's pattern.

A count is *dense* when every row of a trajectory has an entry in each column that any of its seven defects
depends on, and *sparse* when the mass rows keep only what masses depend on (docs/method.md, section 14).
The figure of the paper follows another rule than its text; both are implemented, under different names.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from core.problem import Problem
from core.transcription.builder import build_plan
from core.transcription.layout import CONTROL, STATE, layout_of

#: How many segments a realization has: those that are left, or as many as the reference.
Segmentation = Literal["adaptive", "uniform"]

#: Where realizations start and what they keep.  "nearest": from the nearer half of the reference, without the
#: missed segment, as coastarc does; "forward": always from the forward half; "kept": nearest, with the missed
#: segment repeated.  "published" reproduces the figure of the paper and gives dense entries only.
Rule = Literal["nearest", "forward", "kept"]
DensityRule = Literal["nearest", "forward", "kept", "published"]

# Numbers besides the controls: T_s, T_i, T_f, m_f.
_OTHERS = 4
# Least number of segments of an adaptive realization in the published figure.
_PUBLISHED_LEAST = 10


class Sizes(NamedTuple):
    """Sizes of the Jacobian of one problem."""

    #: Seven defects per trajectory.
    n_rows: int
    n_variables: int
    #: Entries with dense and with sparse mass rows.
    dense: int
    sparse: int

    @property
    def filled(self) -> float:
        """Fraction of the matrix filled by dense rows [-]."""
        return self.dense / (self.n_rows * self.n_variables)


def sizes(
    n_segments: int, segments: Sequence[int], segmentation: Segmentation = "adaptive", rule: Rule = "nearest"
) -> Sizes:
    """Return the size of the Jacobian of P_k from the numbers of segments alone.

    Parameters
    ----------
    n_segments : int
        Segments N of the reference [-].
    segments : sequence of k int
        Segments n at which outages begin, 1 .. N [-]; after one at N no segment is left.
    segmentation : {"adaptive", "uniform"}
        Whether a realization has N - n segments or N.
    rule : {"nearest", "forward", "kept"}
        Where realizations start, see `Rule`.

    Raises
    ------
    ValueError
        When a segment is not one of the reference's, or an option is unknown.

    References
    ----------
    docs/method.md, "Density of the Jacobian".
    """
    _check(n_segments, segmentation, rule, Rule)
    for n in segments:
        if not 1 <= n <= n_segments:
            raise ValueError(f"segments: expected 1 .. {n_segments}, got {n}")
    own = [_realization_segments(n_segments, n, segmentation, rule) for n in segments]
    dependences = [_reference_dependence(n_segments, n, rule) for n in segments]
    columns = [CONTROL * n_segments + _OTHERS, *(CONTROL * n + _OTHERS for n in own)]
    # A mass depends on these of its own variables: throttles, T_s and m_f.
    mass = [n_segments + 2, *(n + 2 for n in own)]
    shared = sum(CONTROL * controls + times for controls, times, _ in dependences)
    shared_mass = sum(controls + times for controls, _, times in dependences)
    dense = STATE * (sum(columns) + shared)
    sparse = (STATE - 1) * (sum(columns) + shared) + sum(mass) + shared_mass
    return Sizes(STATE * len(columns), sum(columns), dense, sparse)


def dense_entries(
    n_segments: int, segments: Sequence[int], segmentation: Segmentation = "adaptive", rule: Rule = "nearest"
) -> int:
    """Return the entries of the Jacobian of P_k with dense mass rows; see `sizes` for the parameters."""
    return sizes(n_segments, segments, segmentation, rule).dense


def _realization_segments(n_segments: int, n: int, segmentation: Segmentation, rule: Rule) -> int:
    if segmentation == "uniform":
        return n_segments
    return n_segments - n + 1 if rule == "kept" else n_segments - n


def _reference_dependence(n_segments: int, n: int, rule: Rule) -> tuple[int, int, int]:
    """Count the reference's controls and others that a realization depends on, and others of its mass."""
    if rule == "forward" or n <= n_segments // 2 + 1:
        # The epoch of the first segment's start does not move with T_s.
        return (n - 1, 2, 1) if n > 1 else (0, 1, 0)
    return n_segments - n + 1, _OTHERS, 2


def _check(n_segments: int, segmentation: str, rule: str, rules: object) -> None:
    if n_segments < 2:
        raise ValueError(f"n_segments: expected at least 2, got {n_segments}")
    for name, value, known in (
        ("segmentation", segmentation, get_args(Segmentation)),
        ("rule", rule, get_args(rules)),
    ):
        if value not in known:
            raise ValueError(f"{name}: expected one of {', '.join(known)}, got {value!r}")


def density_curve(
    m: int, n_values: ArrayLike, segmentation: Segmentation = "adaptive", rule: DensityRule = "nearest"
) -> NDArray[np.int64]:
    """Return the dense entries of the Jacobian against N, with an outage at every m-th segment.

    Parameters
    ----------
    m : int
        Segments from one outage to the next [-]: at n = m, 2m, .. up to N; "published" at n = 0, m, ...
    n_values : (n,) array
        Numbers N of segments of the reference [-].
    segmentation : {"adaptive", "uniform"}
        Whether realizations have as many segments as are left, or N.
    rule : {"nearest", "forward", "kept", "published"}
        How entries are counted, see `DensityRule`.

    Returns
    -------
    (n,) array
        Entries [-].

    Raises
    ------
    ValueError
        When m or a number of segments is too small, or an option is unknown.
    """
    if m < 1:
        raise ValueError(f"m: expected at least 1, got {m}")
    found = []
    for n_segments in np.atleast_1d(n_values).tolist():
        _check(n_segments, segmentation, rule, DensityRule)
        if rule == "published":
            found.append(_published_entries(n_segments, m, segmentation))
        else:
            every = range(m, n_segments + 1, m)
            found.append(dense_entries(n_segments, every, segmentation, rule))
    return np.array(found, dtype=np.int64)


def _published_entries(n_segments: int, m: int, segmentation: Segmentation) -> int:
    """Return the entries by the rule of the paper's figure, docs/method.md, section 14 (J3)."""
    columns = CONTROL * n_segments + _OTHERS
    for n in range(0, n_segments + 1, m):
        own = n_segments
        if segmentation == "adaptive":
            own = max(_PUBLISHED_LEAST, (2 * (n_segments - n) - m) // 4)  # floor((N - n - m/2)/2)
        columns += CONTROL * own + _OTHERS + _OTHERS + CONTROL * min(n, n_segments - n)
    return STATE * columns


def pattern(problem: Problem) -> "scipy.sparse.csr_array":
    """Return where the Jacobian of a problem can have entries, mass rows sparse.

    Parameters
    ----------
    problem : Problem
        P_k.

    Returns
    -------
    (n_defects, n_variables) CSR array
        True where an entry is stored; the same for every x.
    """
    structure = build_plan(problem, layout_of(problem))
    shape = (STATE * len(structure.matchpoints), structure.n_variables)
    stored = np.ones(len(structure.rows), dtype=np.bool_)
    return scipy.sparse.csr_array((stored, (structure.rows, structure.columns)), shape=shape)
