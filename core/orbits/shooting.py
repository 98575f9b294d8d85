"""A ballistic trajectory from a guess: multiple shooting with free epochs and a minimum-norm Newton method.

Patch points hold an epoch and a state; a piece between two of them is flown half forwards from the first
and half backwards from the second, and its defect is the difference in the middle.
Frame: geocentric, axes J2000.  Units: canonical, times in TU past the origin of the force model.

    ShootingError(RuntimeError)   a guess from which the correction does not converge
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from core.dynamics import COAST, ForceModel, propagate
from core.jit import compiled
from core.units import LU_KM, VU_KM_S

Array = NDArray[np.float64]

#: Bounds on the defects of a corrected trajectory.
POSITION_TOLERANCE_KM = 1e-6
VELOCITY_TOLERANCE_KM_S = 1e-9

# Tight, since a perilune magnifies the error of a step three hundred times.
_INTEGRATION_TOLERANCE = 1e-14
_MAX_ITERATIONS = 30


class ShootingError(RuntimeError):
    """A guess from which the correction does not converge."""


def correct(model: ForceModel, epochs: Array, states: Array) -> tuple[Array, Array]:
    """Return epochs and states of patch points near a guess whose pieces join.

    Parameters
    ----------
    model : ForceModel
        Gravity; its table must cover the epochs.
    epochs : (n,) array
        Ascending epochs [TU].
    states : (n, 6) array
        Position and velocity at them [LU, LU/TU].

    Raises
    ------
    ShootingError
        When the defects stay above their bounds.

    References
    ----------
    docs/method.md, eqs. (O6) and (O7).
    """
    unknowns = np.column_stack([epochs, states])
    for _ in range(_MAX_ITERATIONS):
        halves = fly_halves(model, unknowns[:, 0], unknowns[:, 1:])
        defects = halves[:, 0, :, 0] - halves[:, 1, :, 0]
        if _is_joined(defects):
            return unknowns[:, 0].copy(), unknowns[:, 1:].copy()
        if not np.isfinite(defects).all():
            break
        unknowns = unknowns - _smallest_step(_jacobian(halves), defects.ravel()).reshape(-1, 7)
    worst = np.abs(defects).max() * LU_KM
    raise ShootingError(f"shooting: expected defects below {POSITION_TOLERANCE_KM} km, got {worst:.1e} km")


def _is_joined(defects: Array) -> bool:
    position = np.linalg.norm(defects[:, :3], axis=1).max() * LU_KM
    velocity = np.linalg.norm(defects[:, 3:], axis=1).max() * VU_KM_S
    return bool(position < POSITION_TOLERANCE_KM and velocity < VELOCITY_TOLERANCE_KM_S)


def _smallest_step(jacobian: "scipy.sparse.csc_array", defects: Array) -> Array:
    """Return the least step s with jacobian s = defects, from the equations of its Lagrangian."""
    n = jacobian.shape[1]
    system = scipy.sparse.block_array(
        [[scipy.sparse.eye_array(n), jacobian.T], [jacobian, None]], format="csc"
    )
    return np.asarray(scipy.sparse.linalg.splu(system).solve(np.concatenate([np.zeros(n), defects]))[:n])


def _jacobian(halves: Array) -> "scipy.sparse.csc_array":
    """Return the partials of the defects, 6 a piece, by the epoch and the state of each patch point."""
    n_pieces = halves.shape[0]
    rates = halves[:, :, :, 7:]
    # The middle moves by half of each epoch, on both sides of the piece.
    by_middle = 0.5 * (rates[:, 0, :, 1] - rates[:, 1, :, 1])
    blocks = np.empty((n_pieces, 6, 14))
    for side, sign in ((0, 1.0), (1, -1.0)):
        transition = halves[:, side, :, 1:7]
        by_epoch = by_middle - sign * np.einsum("pij,pj->pi", transition, rates[:, side, :, 0])
        blocks[:, :, 7 * side] = by_epoch
        blocks[:, :, 7 * side + 1 : 7 * side + 7] = sign * transition
    rows = np.broadcast_to(np.arange(6 * n_pieces).reshape(-1, 6, 1), blocks.shape)
    columns = np.broadcast_to(7 * np.arange(n_pieces)[:, None, None] + np.arange(14), blocks.shape)
    shape = (6 * n_pieces, 7 * (n_pieces + 1))
    return scipy.sparse.csc_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=shape)


@compiled
def fly_halves(model: ForceModel, epochs: Array, states: Array) -> Array:
    """Return both halves (n - 1, 2, 6, 9) of every piece, NaN where one cannot be flown.

    Parameters
    ----------
    model : ForceModel
        Gravity.
    epochs, states : (n,) and (n, 6) arrays
        Patch points [TU; LU, LU/TU].

    Returns
    -------
    (n - 1, 2, 6, 9) array
        Per half the state in the middle, its partials by the state at the patch point (6 columns), and the
        rates of the state at the patch point and in the middle [canonical].
    """
    out = np.empty((epochs.size - 1, 2, 6, 9))
    ends, work = np.empty((2, 3)), np.empty((16, 3, COAST))
    for piece in range(epochs.size - 1):
        middle = 0.5 * (epochs[piece] + epochs[piece + 1])
        for side in range(2):
            start = states[piece + side]
            r, v = np.zeros((3, COAST)), np.zeros((3, COAST))
            for i in range(3):
                r[i, 0], v[i, 0] = start[i], start[3 + i]
                r[i, 1 + i] = v[i, 4 + i] = 1.0
            steps = coast(model, epochs[piece + side], middle, r, v, ends, work)
            half = out[piece, side]
            half[:3, :7], half[3:, :7] = r[:, :7], v[:, :7]
            half[:3, 7], half[:3, 8] = start[3:], v[:, 0]
            half[3:, 7], half[3:, 8] = ends[0], ends[1]
            if steps < 0:
                half[:] = np.nan
    return out


@compiled
def coast(model: ForceModel, t_a: float, t_b: float, r: Array, v: Array, ends: Array, work: Array) -> int:
    """Fly without thrust in place; arguments and result are those of `core.dynamics.propagate`."""
    # Made here, since constant arrays would make numba compile the integrator once more for their own type.
    nothing, no_partials = np.zeros(3), np.zeros((3, 3))
    return propagate(
        model,
        t_a,
        t_b,
        1.0,
        nothing,
        0.0,
        no_partials,
        nothing,
        _INTEGRATION_TOLERANCE,
        r,
        v,
        ends,
        work,
    )
