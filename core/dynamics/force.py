"""Point-mass gravity of Earth, Moon, Sun and Jupiter on the spacecraft, with its gradient.

Frame: geocentric, axes J2000.  Units: canonical; times in TU past the departure epoch.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.constants import G0, GM_EARTH, GM_JUPITER, GM_MOON, GM_SUN
from core.ephemeris import EphemerisTable
from core.jit import compiled
from core.problem import Problem
from core.units import exhaust_velocity_canonical, gm_canonical, thrust_canonical

Array = NDArray[np.float64]


class ForceModel(NamedTuple):
    """What the equations of motion need, in a form that compiled code can take."""

    #: (4,) gravitational parameters of Earth, Moon, Sun, Jupiter [LU^3/TU^2].
    gm: Array
    #: Thrust at throttle 1 [MU LU/TU^2].
    max_thrust: float
    #: Exhaust velocity [LU/TU].
    exhaust_velocity: float
    #: Positions of Moon, Sun and Jupiter.
    bodies: EphemerisTable


def force_model(problem: Problem, bodies: EphemerisTable) -> ForceModel:
    """Return the force model of a problem over the span of an ephemeris table."""
    craft = problem.spacecraft
    return ForceModel(
        gm=np.array([gm_canonical(gm) for gm in (GM_EARTH, GM_MOON, GM_SUN, GM_JUPITER)]),
        max_thrust=thrust_canonical(craft.max_thrust_n),
        exhaust_velocity=exhaust_velocity_canonical(craft.isp_s, G0),
        bodies=bodies,
    )


@compiled
def _inverse_cube(square: float) -> float:
    # A root and a division cost a third of the power function.
    return float(1.0 / (square * np.sqrt(square)))


@compiled
def acceleration(gm: Array, bodies: Array, r: Array, out: Array) -> None:
    """Write the gravitational acceleration relative to the Earth, docs/method.md eq. 2.

    Parameters
    ----------
    gm : (4,) array
        Gravitational parameters of Earth, Moon, Sun, Jupiter [LU^3/TU^2].
    bodies : (9,) array
        Positions of Moon, Sun, Jupiter [LU].
    r : (3,) array
        Spacecraft position [LU].
    out : (3,) array
        Acceleration [LU/TU^2].
    """
    pull = gm[0] * _inverse_cube(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    ax, ay, az = -pull * r[0], -pull * r[1], -pull * r[2]
    for b in range(3):
        bx, by, bz = bodies[3 * b], bodies[3 * b + 1], bodies[3 * b + 2]
        dx, dy, dz = bx - r[0], by - r[1], bz - r[2]
        pull = gm[b + 1] * _inverse_cube(dx * dx + dy * dy + dz * dz)
        # The Earth falls too, so only the difference of the two pulls is felt.
        fall = gm[b + 1] * _inverse_cube(bx * bx + by * by + bz * bz)
        ax += pull * dx - fall * bx
        ay += pull * dy - fall * by
        az += pull * dz - fall * bz
    out[0], out[1], out[2] = ax, ay, az


@compiled
def gravity_gradient(gm: Array, bodies: Array, r: Array, out: Array) -> None:
    """Write d acceleration / d r, docs/method.md eq. 4: symmetric and without trace.

    Parameters
    ----------
    gm, bodies, r
        As for `acceleration`.
    out : (6,) array
        Entries xx, xy, xz, yy, yz, zz [1/TU^2].
    """
    out[:] = 0.0
    for b in range(4):
        dx, dy, dz = r[0], r[1], r[2]
        if b > 0:
            dx -= bodies[3 * b - 3]
            dy -= bodies[3 * b - 2]
            dz -= bodies[3 * b - 1]
        square = dx * dx + dy * dy + dz * dz
        pull = gm[b] * _inverse_cube(square)
        tide = 3.0 * pull / square
        out[0] += tide * dx * dx - pull
        out[1] += tide * dx * dy
        out[2] += tide * dx * dz
        out[3] += tide * dy * dy - pull
        out[4] += tide * dy * dz
        out[5] += tide * dz * dz - pull
