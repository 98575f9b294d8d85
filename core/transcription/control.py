"""Spherical controls: throttle, in-plane and out-of-plane angle of a segment.

The angles are azimuth and elevation of the thrust in J2000 axes.  At throttle 0 both angle columns vanish,
as they do for the azimuth at elevation +-pi/2: docs/method.md, section 5.
"""

import numpy as np
from numpy.typing import NDArray

from core.jit import compiled

Array = NDArray[np.float64]


@compiled
def thrust_of(control: Array, max_thrust: float, thrust: Array, d_thrust: Array) -> None:
    """Write the thrust vector of a control and its partials.

    Parameters
    ----------
    control : (3,) array
        Throttle [-], in-plane angle [rad], out-of-plane angle [rad].
    max_thrust : float
        Thrust at throttle 1 [MU LU/TU^2].
    thrust : (3,) array
        Thrust in J2000 axes [MU LU/TU^2].
    d_thrust : (3, 3) array
        d thrust / d control, one row per control.
    """
    size = max_thrust * control[0]
    ct, st = np.cos(control[1]), np.sin(control[1])
    cb, sb = np.cos(control[2]), np.sin(control[2])
    d_thrust[0, 0], d_thrust[0, 1], d_thrust[0, 2] = (
        max_thrust * cb * ct,
        max_thrust * cb * st,
        max_thrust * sb,
    )
    d_thrust[1, 0], d_thrust[1, 1], d_thrust[1, 2] = -size * cb * st, size * cb * ct, 0.0
    d_thrust[2, 0], d_thrust[2, 1], d_thrust[2, 2] = -size * sb * ct, -size * sb * st, size * cb
    for i in range(3):
        thrust[i] = control[0] * d_thrust[0, i]


def control_of(throttle_vector: Array) -> Array:
    """Return the controls of throttle vectors, the inverse of `thrust_of` over the maximum thrust.

    Parameters
    ----------
    throttle_vector : (n, 3) array
        Thrust over maximum thrust in J2000 axes [-].

    Returns
    -------
    (n, 3) array
        Throttle [-], in-plane and out-of-plane angle [rad]; both angles are 0 where the throttle is 0.
    """
    throttle = np.linalg.norm(throttle_vector, axis=1)
    in_plane = np.arctan2(throttle_vector[:, 1], throttle_vector[:, 0])
    out_of_plane = np.arctan2(throttle_vector[:, 2], np.hypot(throttle_vector[:, 0], throttle_vector[:, 1]))
    return np.stack([throttle, in_plane, out_of_plane], axis=1)


def throttle_of(controls: Array) -> Array:
    """Return the throttle vectors (n, 3) [-] in J2000 axes of controls (n, 3) [-, rad, rad]."""
    throttle, in_plane, out_of_plane = controls.T
    flat = np.cos(out_of_plane)
    direction = [flat * np.cos(in_plane), flat * np.sin(in_plane), np.sin(out_of_plane)]
    return np.asarray((throttle * np.array(direction)).T)
