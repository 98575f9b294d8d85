"""The instantaneous Earth-Moon frame: x along the Moon's position, z along its angular momentum.

Frame: origin and axes as each function says; J2000 where nothing is said.  Units: canonical.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.constants import MU_CR3BP

Array = NDArray[np.float64]


class RotatingFrame(NamedTuple):
    """Axes and scale of the frame at one epoch, and how both change."""

    #: (3, 3) columns are the axes, in J2000.
    axes: Array
    #: (3,) angular velocity in J2000 [1/TU].
    rotation: Array
    #: Distance of the Moon [LU] and its rate [LU/TU].
    distance: float
    distance_rate: float


def rotating_frame(moon: Array) -> RotatingFrame:
    """Return the frame that the Moon's motion defines.

    Parameters
    ----------
    moon : (3, 3) array
        Geocentric position, velocity and acceleration of the Moon [LU, LU/TU, LU/TU^2].

    References
    ----------
    docs/method.md, eq. (O2).
    """
    position, velocity, acceleration = moon
    distance = float(np.linalg.norm(position))
    momentum = np.cross(position, velocity)
    x, z = position / distance, momentum / np.linalg.norm(momentum)
    # About z as the Moon moves on; about x as the plane of its orbit tips.
    about_z = float(np.linalg.norm(momentum)) / distance**2
    about_x = distance * float(acceleration @ z) / float(np.linalg.norm(momentum))
    return RotatingFrame(
        np.column_stack([x, np.cross(z, x), z]), about_x * x + about_z * z, distance, float(velocity @ x)
    )


def to_inertial(frame: RotatingFrame, place: Array, rate: Array) -> tuple[Array, Array]:
    """Return position and velocity (3,) in J2000 axes of a point of the frame, about the frame's origin.

    Parameters
    ----------
    frame : RotatingFrame
        Frame at the epoch.
    place, rate : (3,) arrays
        Position in units of the Moon's distance [-] and its rate [1/TU], in the frame.
    """
    direction = frame.axes @ place
    position = frame.distance * direction
    velocity = (
        frame.distance * (frame.axes @ rate)
        + np.cross(frame.rotation, position)
        + frame.distance_rate * direction
    )
    return position, velocity


def jacobi(moon: Array, position: Array, velocity: Array) -> float:
    """Return the Jacobi constant [-] of a geocentric state in the instantaneous frame.

    Exact in the CR3BP, an indication in the ephemeris: docs/method.md, eq. (O3).

    Parameters
    ----------
    moon : (3, 3) array
        Geocentric position, velocity and acceleration of the Moon [LU, LU/TU, LU/TU^2].
    position, velocity : (3,) arrays
        Geocentric state [LU, LU/TU].
    """
    frame = rotating_frame(moon)
    scale, spin = frame.distance, float(frame.rotation @ frame.axes[:, 2])
    barycentric = (position - MU_CR3BP * moon[0]) @ frame.axes / scale
    inertial_rate = (velocity - MU_CR3BP * moon[1]) @ frame.axes / (scale * spin)
    rate = inertial_rate - np.cross([0.0, 0.0, 1.0], barycentric)
    to_earth = np.linalg.norm(position) / scale
    to_moon = np.linalg.norm(position - moon[0]) / scale
    potential = 2.0 * (1.0 - MU_CR3BP) / to_earth + 2.0 * MU_CR3BP / to_moon
    return float(barycentric[0] ** 2 + barycentric[1] ** 2 + potential - rate @ rate)
