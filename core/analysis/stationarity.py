"""How far a decision vector is from a local optimum of P_k, whatever solver found it.

Input: a decision vector in the paper's variables.  Output: the projected gradient of the Lagrangian of the
objective -m_f, with least-squares multipliers.  Canonical units (docs/method.md, section 1); the objective is
in MU, so components are in MU per TU, per radian, per unit of throttle.  Only the transcription is shared
with the solver, in its single-matchpoint form.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.transcription import FINE_TOLERANCE, Transcription, checked_vector

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Largest component of a locally optimal vector [MU per canonical unit]: 0.015 kg per unit of throttle, where
#: the whole burn of a segment of 1.5 days is worth 5 kg.
OPTIMAL = 1e-6

#: Fraction of a bound's width within which a variable counts as at the bound.
AT_BOUND = 1e-6


# Singular values below this fraction of the largest are rounding.
_RANK = 1e-14
# The active set changes by a few entries a step; 3 to 12 steps were measured.
_MOST_STEPS, _HALVINGS = 200, 40


@dataclass(frozen=True, slots=True, eq=False)
class Stationarity:
    """The first-order conditions at one decision vector."""

    #: Largest component of the projected gradient [MU per canonical unit]; infinite where it is undefined.
    residual: float
    #: (n_variables,) gradient of the Lagrangian, zero at active bounds [MU per canonical unit].
    gradient: Array
    #: (n_defects,) multipliers of the defects [MU per LU, VU, MU].
    multipliers: Array

    @property
    def is_optimal(self) -> bool:
        """Whether the vector is locally optimal to first order, if its defects vanish."""
        return self.residual <= OPTIMAL


class Box(NamedTuple):
    """Which variables are at a bound; none at both."""

    #: (n,) where the gradient may be positive, and where negative.
    at_lower: Mask
    at_upper: Mask


def stationarity(transcription: Transcription, x: Array) -> Stationarity:
    """Return the first-order conditions of P_k at a decision vector.

    A variable within `AT_BOUND` of a bound may have a gradient that points out of the box.  The bounds of
    the angles are seams of the sphere, not limits, so angles never count as bounded.  The angles of an unlit
    segment have no gradient.

    Parameters
    ----------
    transcription : Transcription
        The problem; its tolerance has no effect.
    x : (n_variables,) array
        Decision vector [days, rad, kg].

    Returns
    -------
    Stationarity
        With an infinite residual where a trajectory cannot be propagated.

    Raises
    ------
    ValueError
        When x has another shape or is not finite.

    References
    ----------
    docs/measuring.md, "Locally optimal".
    """
    x = checked_vector(transcription.layout, x)
    fine = transcription.at_tolerance(FINE_TOLERANCE)
    rows = np.tile(transcription.state_scale, len(transcription.layout.trajectories))
    jacobian = fine.jacobian(x).toarray() * transcription.scale / rows[:, None]
    if not np.all(np.isfinite(jacobian)):
        return Stationarity(np.inf, np.full(len(x), np.nan), np.full(len(rows), np.nan))
    objective = np.zeros(len(x))
    objective[transcription.layout.reference.final_mass] = -1.0
    gradient, multipliers = projected_gradient(objective, jacobian, _box(transcription, x))
    return Stationarity(float(np.max(np.abs(gradient))), gradient, multipliers)


def projected_gradient(objective: Array, jacobian: Array, box: Box) -> tuple[Array, Array]:
    """Return the projected gradient of the Lagrangian with least-squares multipliers, and these.

    The multipliers minimize phi(m) = |P(g + J^T m)|^2, where P drops components at active bounds.  phi
    is convex and piecewise quadratic; Newton's method with halved steps reaches its minimum in finitely many.

    Parameters
    ----------
    objective : (n,) array
        Gradient g of the objective.
    jacobian : (m, n) array
        Partials J of the constraints, which may be dependent.
    box : Box
        Variables at bounds.

    Returns
    -------
    (n,) array, (m,) array
        P(g + J^T m), and m.
    """
    basis, to_multipliers = _range_of(jacobian)
    weights = np.zeros(basis.shape[1])
    left = objective.copy()
    for _ in range(_MOST_STEPS):
        is_open = ~_at_active_bound(left, box)
        step = np.linalg.lstsq(basis[is_open], -left[is_open], rcond=None)[0]
        size = _step_size(left, basis @ step, box)
        if size == 0.0:
            break
        weights += size * step
        left = objective + basis @ weights
    return _project(left, box), to_multipliers @ weights


def _range_of(jacobian: Array) -> tuple[Array, Array]:
    """Return an orthonormal basis (n, r) of the rows of J, and the map (m, r) from weights to multipliers."""
    norms = np.linalg.norm(jacobian, axis=1)
    norms[norms == 0.0] = 1.0
    left, values, right = np.linalg.svd(jacobian / norms[:, None], full_matrices=False)
    kept = values > _RANK * values[0]
    return right[kept].T, left[:, kept] / values[kept] / norms[:, None]


def _at_active_bound(gradient: Array, box: Box) -> Mask:
    """Return where a bound is active: where the descent direction points out of the box."""
    active: Mask = (box.at_lower & (gradient > 0.0)) | (box.at_upper & (gradient < 0.0))
    return active


def _project(gradient: Array, box: Box) -> Array:
    return np.where(_at_active_bound(gradient, box), 0.0, gradient)


def _step_size(left: Array, change: Array, box: Box) -> float:
    """Return the largest of 1, 1/2, 1/4, .. with which the change decreases phi, or 0 at its minimum."""
    least, size = float(np.sum(_project(left, box) ** 2)), 1.0
    for _ in range(_HALVINGS):
        # A smaller decrease is rounding.
        if float(np.sum(_project(left + size * change, box) ** 2)) < least * (1.0 - 1e-14):
            return size
        size *= 0.5
    return 0.0


def _box(transcription: Transcription, x: Array) -> Box:
    lower, upper = transcription.bounds
    near = AT_BOUND * (upper - lower)
    bounded = np.ones(len(x), dtype=bool)
    for trajectory in transcription.layout.trajectories:
        for segment in range(1, trajectory.n_segments + 1):
            throttle = trajectory.control(segment)
            bounded[throttle + 1 : throttle + 3] = False
    return Box(bounded & (x <= lower + near), bounded & (x >= upper - near))
