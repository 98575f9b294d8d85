"""Samples along one arc, dense where it curves and sparse where it does not.

Frame: geocentric, J2000 axes.  Units: canonical; times in TU past the departure epoch.
"""

import numpy as np
from numpy.typing import NDArray

from core.dynamics import ForceModel, propagate
from core.ephemeris import positions
from core.jit import compiled
from core.transcription.control import thrust_of
from core.units import TU_DAYS

Array = NDArray[np.float64]

#: Most samples of one arc, its start included.
MAX_SAMPLES = 4000
# In a quarter of a day the rotating frame turns by three degrees.
_MAX_STEP = 0.25 / TU_DAYS
#: Relative tolerance of the steps unless asked for otherwise: what it leaves, 0.04 km or so, is far below a
#: pixel of any picture.
TOLERANCE = 1e-9


@compiled
def sample_arc(
    model: ForceModel,
    t_a: float,
    t_b: float,
    control: Array,
    per_radian: float,
    tolerance: float,
    times: Array,
    states: Array,
) -> int:
    """Fly one arc and write samples of it, the first of which is already there.

    Parameters
    ----------
    model : ForceModel
        Forces; its table must cover the arc.
    t_a, t_b : float
        Start and end [TU], in either order.
    control : (3,) array
        Throttle [-], in-plane and out-of-plane angle [rad].
    per_radian : float
        Samples per radian of a circular orbit about the nearer body [1/rad].
    tolerance : float
        Relative tolerance of a step [-].
    times : (MAX_SAMPLES,) array
        Epochs of the samples [TU].
    states : (MAX_SAMPLES, 7) array
        Position [LU], velocity [LU/TU], mass [MU]; row 0 is the state at t_a.

    Returns
    -------
    int
        Number of samples; those after a failure are NaN.
    """
    thrust, d_thrust, d_rate = np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    ends, work = np.zeros((2, 3)), np.zeros((16, 3, 1))
    r, v = np.zeros((3, 1)), np.zeros((3, 1))
    bodies = np.empty(model.bodies.coefficients.shape[2])
    thrust_of(control, model.max_thrust, thrust, d_thrust)
    mass_rate = control[0] * model.max_thrust / model.exhaust_velocity
    times[0] = t_a
    n = 1
    while times[n - 1] != t_b and n < MAX_SAMPLES:
        t, state = times[n - 1], states[n - 1]
        positions(model.bodies, t, bodies)
        step = min(_free_fall(model.gm, bodies, state) / per_radian, _MAX_STEP)
        # The last sample allowed ends the arc; a step that nearly reaches the end does too.
        if not step < 0.999 * abs(t_b - t) or n == MAX_SAMPLES - 1:
            times[n] = t_b
        else:
            times[n] = t + step if t_b > t_a else t - step
        for i in range(3):
            r[i, 0], v[i, 0] = state[i], state[3 + i]
        taken = propagate(
            model, t, times[n], state[6], thrust, mass_rate, d_thrust, d_rate, tolerance, r, v, ends, work
        )
        for i in range(3):
            states[n, i] = r[i, 0] if taken >= 0 else np.nan
            states[n, 3 + i] = v[i, 0] if taken >= 0 else np.nan
        states[n, 6] = state[6] - mass_rate * (times[n] - t)
        n += 1
    return n


@compiled
def _free_fall(gm: Array, bodies: Array, state: Array) -> float:
    """Return the time in which a circular orbit about the Earth or the Moon turns by a radian, the lesser."""
    to_earth = (state[0] ** 2 + state[1] ** 2 + state[2] ** 2) ** 1.5 / gm[0]
    x, y, z = state[0] - bodies[0], state[1] - bodies[1], state[2] - bodies[2]
    to_moon = (x * x + y * y + z * z) ** 1.5 / gm[1]
    return float(min(to_earth, to_moon) ** 0.5)
