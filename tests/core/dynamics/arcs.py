"""One arc as a function from plain arrays to plain arrays, which the kernel is not."""

from functools import cache

import numpy as np

from core.dynamics import STATE, THRUST, force_model, propagate
from core.ephemeris import body_table
from core.epochs import seconds_past_j2000
from core.problem import load_problem

PRESET = load_problem("ppe-drm3")
ORIGIN_ET = seconds_past_j2000(PRESET.departure.epoch)
ZERO = np.zeros(3)


@cache
def preset_model():
    return force_model(PRESET, body_table(ORIGIN_ET, -180.0, 180.0))


def fly(model, t_a, t_b, y, thrust=ZERO, mass_rate=0.0, tolerance=1e-13):
    """Return the status and the end state (7,) of one arc in canonical units."""
    r, v = np.array(y[:3]).reshape(3, 1), np.array(y[3:6]).reshape(3, 1)
    status = propagate(
        model, t_a, t_b, y[6], np.asarray(thrust, dtype=float), mass_rate, np.zeros((3, 3)), ZERO, tolerance,
        r, v, np.zeros((2, 3)), np.zeros((16, 3, STATE)),
    )  # fmt: skip
    return status, np.concatenate([r[:, 0], v[:, 0], [y[6] - mass_rate * (t_b - t_a)]])


def fly_with_partials(model, t_a, t_b, y, thrust, mass_rate, d_thrust, d_rate, tolerance=1e-13):
    """Return the end (6,), its partials (6, 10) by r0, v0, m0 and control, and the accelerations (2, 3)."""
    r, v, ends = np.zeros((3, THRUST)), np.zeros((3, THRUST)), np.zeros((2, 3))
    r[:, 0], v[:, 0] = y[:3], y[3:6]
    r[:, 1:4] = v[:, 4:7] = np.eye(3)
    status = propagate(
        model, t_a, t_b, y[6], thrust, mass_rate, d_thrust, d_rate, tolerance, r, v, ends,
        np.zeros((16, 3, THRUST)),
    )  # fmt: skip
    assert status > 0
    columns = np.vstack([r, v])
    return columns[:, 0], columns[:, 1:], ends
