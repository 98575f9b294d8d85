"""Second derivatives of an arc by quadrature along its trail, with a costate that needs no equation.

Weights l of the end of an arc come in, the Hessian of l . end by (r_a, v_a, m_a, u) goes out.
"""

import numpy as np

from core.dynamics.dop853 import THRUST, TRAIL_BODIES, TRAIL_TIME, TRAIL_WEIGHT
from core.dynamics.force import Array, gravity_bend
from core.jit import compiled

#: Moments of the costate along an arc: sum of l_v t^j / m^i for (i, j) in this order.
MOMENTS = ((1, 0), (2, 0), (2, 1), (3, 0), (3, 1), (3, 2))


@compiled
def bend_along(
    gm: Array,
    trail: Array,
    costate: Array,
    mass: float,
    mass_rate: float,
    bend: Array,
    moments: Array,
) -> None:
    """Integrate what gravity and thrust bend, docs/method.md eqs. 26-29.

    Parameters
    ----------
    gm : (4,) array
        Gravitational parameters [LU^3/TU^2].
    trail : (n, TRAIL_WIDTH) array
        The stages of the arc, see `core.dynamics.dop853.integrate`.
    costate : (7,) array
        Weights l at t_a of r, v and m.
    mass, mass_rate : float
        Mass at t_a [MU] and its loss per unit time [MU/TU].
    bend : (THRUST, THRUST) array
        Sum of Psi^T (d2 (l_v . gravity) / d r2) Psi, written; rows and columns as those of a trail, lower
        triangle from row and column 1 on.
    moments : (6, 3) array
        Integrals of l_v t^j / m^i, see `MOMENTS`, written.
    """
    bend[:] = 0.0
    moments[:] = 0.0
    turned = np.empty((3, THRUST))
    l_r, l_v = costate[:3], costate[3:6]
    for k in range(trail.shape[0]):
        row = trail[k]
        weight = row[TRAIL_WEIGHT]
        lx, ly, lz = _costate(row, 0, l_r, l_v), _costate(row, 1, l_r, l_v), _costate(row, 2, l_r, l_v)
        lx, ly, lz = weight * lx, weight * ly, weight * lz
        _add_moments(row[TRAIL_TIME], mass - mass_rate * row[TRAIL_TIME], lx, ly, lz, moments)
        xx, xy, xz, yy, yz, zz = gravity_bend(
            gm, row[TRAIL_BODIES:], row[0], row[THRUST], row[2 * THRUST], lx, ly, lz
        )
        for q in range(THRUST):
            x, y, z = row[q], row[THRUST + q], row[2 * THRUST + q]
            turned[0, q] = xx * x + xy * y + xz * z
            turned[1, q] = xy * x + yy * y + yz * z
            turned[2, q] = xz * x + yz * y + zz * z
        for p in range(1, THRUST):
            x, y, z = row[p], row[THRUST + p], row[2 * THRUST + p]
            for q in range(THRUST):
                bend[p, q] += x * turned[0, q] + y * turned[1, q] + z * turned[2, q]


@compiled
def _costate(row: Array, i: int, l_r: Array, l_v: Array) -> float:
    """Return component i of l_v at a stage; eq. 27, from the symmetry of gravity's gradient."""
    at = THRUST * i + 1
    total = 0.0
    for j in range(3):
        total += row[at + j] * l_v[j] - row[at + 3 + j] * l_r[j]
    return total


@compiled
def _add_moments(t: float, mass: float, lx: float, ly: float, lz: float, moments: Array) -> None:
    inverse = 1.0 / mass
    square = inverse * inverse
    cube = square * inverse
    factors = (inverse, square, square * t, cube, cube * t, cube * t * t)
    for n in range(6):
        moments[n, 0] += factors[n] * lx
        moments[n, 1] += factors[n] * ly
        moments[n, 2] += factors[n] * lz
