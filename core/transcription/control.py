"""Controls of a segment: throttle, in-plane and out-of-plane angle; inside a solver also throttle vectors.

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


@compiled
def bend_of(control: Array, max_thrust: float, dd_thrust: Array) -> None:
    """Write the second derivatives of the thrust of a control.

    Parameters
    ----------
    control : (3,) array
        Throttle [-], in-plane angle [rad], out-of-plane angle [rad].
    max_thrust : float
        Thrust at throttle 1 [MU LU/TU^2].
    dd_thrust : (3, 3, 3) array
        d2 thrust / d control2, the controls first.
    """
    size = max_thrust * control[0]
    ct, st = np.cos(control[1]), np.sin(control[1])
    cb, sb = np.cos(control[2]), np.sin(control[2])
    # The in-plane angle turns about the third axis, the other one tilts.
    turned, tilted = (-cb * st, cb * ct, 0.0), (-sb * ct, -sb * st, cb)
    both, twice_turned = (sb * st, -sb * ct, 0.0), (-cb * ct, -cb * st, 0.0)
    direction = (cb * ct, cb * st, sb)
    for i in range(3):
        dd_thrust[0, 0, i] = 0.0
        dd_thrust[0, 1, i] = dd_thrust[1, 0, i] = max_thrust * turned[i]
        dd_thrust[0, 2, i] = dd_thrust[2, 0, i] = max_thrust * tilted[i]
        dd_thrust[1, 1, i] = size * twice_turned[i]
        dd_thrust[1, 2, i] = dd_thrust[2, 1, i] = size * both[i]
        dd_thrust[2, 2, i] = -size * direction[i]


@compiled
def push_of(
    is_vector: bool,
    control: Array,
    max_thrust: float,
    max_rate: float,
    thrust: Array,
    d_thrust: Array,
    d_rate: Array,
) -> float:
    """Write thrust and partials of either kind of control, docs/method.md eqs. S1, S2 and S6.

    Parameters
    ----------
    is_vector : bool
        Whether the control is a throttle vector [-], and not a throttle and two angles [-, rad, rad].
    control : (3,) array
        The control.
    max_thrust, max_rate : float
        Thrust [MU LU/TU^2] and mass lost per unit time [MU/TU] at throttle 1.
    thrust : (3,) array
        Thrust [MU LU/TU^2].
    d_thrust, d_rate : (3, 3) array, (3,) array
        d thrust / d control, one row per control, and d rate / d control.

    Returns
    -------
    float
        Mass lost per unit time [MU/TU].
    """
    if not is_vector:
        thrust_of(control, max_thrust, thrust, d_thrust)
        d_rate[0], d_rate[1], d_rate[2] = max_rate, 0.0, 0.0
        return float(max_rate * control[0])
    throttle = _length(control)
    d_thrust[:] = 0.0
    for i in range(3):
        thrust[i] = max_thrust * control[i]
        d_thrust[i, i] = max_thrust
        # At the kink any slope will do; zero lets an unlit segment light up in any direction.
        d_rate[i] = max_rate * control[i] / throttle if throttle > 0.0 else 0.0
    return float(max_rate * throttle)


@compiled
def push_bend_of(
    is_vector: bool,
    control: Array,
    max_thrust: float,
    max_rate: float,
    dd_thrust: Array,
    dd_rate: Array,
) -> None:
    """Write the second derivatives of what `push_of` gives.

    Parameters
    ----------
    is_vector, control, max_thrust, max_rate
        As for `push_of`.
    dd_thrust : (3, 3, 3) array
        d2 thrust / d control2, the controls first.
    dd_rate : (3, 3) array
        d2 rate / d control2.
    """
    dd_rate[:] = 0.0
    if not is_vector:
        bend_of(control, max_thrust, dd_thrust)
        return
    dd_thrust[:] = 0.0
    throttle = _length(control)
    if throttle > 0.0:
        for i in range(3):
            for j in range(3):
                along = control[i] * control[j] / (throttle * throttle)
                dd_rate[i, j] = max_rate / throttle * ((1.0 if i == j else 0.0) - along)


@compiled
def _length(vector: Array) -> float:
    square = vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]
    return float(np.sqrt(square))


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


def wrapped(controls: Array) -> Array:
    """Return controls (n, 3) [-, rad, rad] of the same thrust with angles in -pi .. pi and -pi/2 .. pi/2."""
    throttle, in_plane, out_of_plane = controls.T
    folded = np.arctan2(np.sin(out_of_plane), np.abs(np.cos(out_of_plane)))
    turned = in_plane + np.where(np.cos(out_of_plane) < 0.0, np.pi, 0.0)
    return np.stack([throttle, np.arctan2(np.sin(turned), np.cos(turned)), folded], axis=1)
