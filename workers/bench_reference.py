"""The same arcs by SciPy's DOP853 with the variational equations; its right-hand side is compiled too."""

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from core.dynamics.force import FIELD_WIDTH, field_at, gravity, gravity_gradient
from core.jit import compiled
from core.transcription import Transcription
from core.transcription.control import thrust_of
from workers.bench_work import Flight

Array = NDArray[np.float64]
#: Columns: by position, velocity, mass and control.
_COLUMNS = 10


def fly_with_scipy(transcription: Transcription, flight: Flight) -> Array:
    """Return state and partials (n_arcs, 7 + 60) at the ends of all arcs [canonical]."""
    model, tolerance = transcription.setting.model, transcription.tolerance
    flow = model.max_thrust / model.exhaust_velocity
    out = np.empty((len(flight.starts), 7 + 6 * _COLUMNS))
    for n, (start, span, control) in enumerate(
        zip(flight.starts, flight.moments, flight.controls, strict=True)
    ):
        thrust, d_thrust = np.empty(3), np.empty((3, 3))
        thrust_of(control, model.max_thrust, thrust, d_thrust)
        field = model.field
        push = (span[0], thrust, control[0] * flow, d_thrust, flow)
        table = (field.start, field.record, field.coefficients)
        y = np.concatenate([start, np.eye(6, _COLUMNS).ravel()])
        arc = solve_ivp(
            _rates, span, y, method="DOP853", rtol=tolerance, atol=tolerance, args=(model.gm, *table, *push)
        )
        out[n] = arc.y[:, -1]
    return out


@compiled
def _rates(
    t: float, y: Array, gm: Array, start: float, record: float, coefficients: Array,
    t_a: float, thrust: Array, mass_rate: float, d_thrust: Array, flow: float,
) -> Array:  # fmt: skip
    """Return the derivative of state and partials, docs/method.md eqs. 2-5."""
    field, out = np.empty(FIELD_WIDTH), np.empty(y.size)
    field_at(start, record, coefficients, t, field)
    a = gravity(gm, field, y[0], y[1], y[2])
    xx, xy, xz, yy, yz, zz = gravity_gradient(gm, field, y[0], y[1], y[2])
    inverse = 1.0 / y[6]
    for i in range(3):
        out[i], out[3 + i] = y[3 + i], a[i] + thrust[i] * inverse
    out[6] = -mass_rate
    columns, rates = y[7:].reshape(6, _COLUMNS), out[7:].reshape(6, _COLUMNS)
    rates[:3] = columns[3:]
    for q in range(_COLUMNS):
        r0, r1, r2 = columns[0, q], columns[1, q], columns[2, q]
        rates[3, q] = xx * r0 + xy * r1 + xz * r2
        rates[4, q] = xy * r0 + yy * r1 + yz * r2
        rates[5, q] = xz * r0 + yz * r1 + zz * r2
    for i in range(3):
        rates[3 + i, 6] -= thrust[i] * inverse * inverse
        for j in range(3):
            rates[3 + i, 7 + j] += d_thrust[j, i] * inverse
        # Only the throttle changes the mass.
        rates[3 + i, 7] += thrust[i] * inverse * inverse * flow * (t - t_a)
    return out
