"""Second derivatives of the end of one arc by everything that it depends on: docs/method.md, eqs. 26-32.

Variables of an arc, in this order: its start state y_a (7), control u (3), t_a, t_b.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.dynamics import THRUST, ForceModel
from core.dynamics.curvature import bend_along
from core.dynamics.force import gravity_gradient, gravity_rate
from core.ephemeris import states
from core.jit import compiled
from core.transcription.control import push_bend_of, push_of
from core.transcription.plan import Plan

Array = NDArray[np.float64]
_N = 7

#: Where the control, t_a and t_b stand among the variables of an arc, and their number.
CONTROL_AT, START_AT, END_AT, N_VARIABLES = 7, 10, 11, 12


class Desk(NamedTuple):
    """What the second derivatives of one arc are worked out on."""

    #: Thrust [MU LU/TU^2] and its first and second derivatives by the control, controls first.
    thrust: Array
    d_thrust: Array
    dd_thrust: Array
    #: (3,), (3, 3) the same of the mass lost per unit time [MU/TU].
    d_rate: Array
    dd_rate: Array
    #: (7, 12) and (12, 12) derivatives of the end, and of its weighted sum: rows of the latter that count are
    #: those of the start state, whole, and the lower triangle of the others.
    first: Array
    second: Array
    #: See `core.dynamics.curvature.bend_along`.
    bend: Array
    moments: Array
    #: (11,) weights of F at one end by y, u and t; (3, 16) and (6,) the bodies and the gradient there.
    pull: Array
    field: Array
    #: (18, 12) for sums.
    sums: Array


@compiled
def desk(field_width: int) -> Desk:
    """Return an empty desk for a force model whose field has that many columns [-]."""
    return Desk(
        np.zeros(3),
        np.zeros((3, 3)),
        np.zeros((3, 3, 3)),
        np.zeros(3),
        np.zeros((3, 3)),
        np.zeros((_N, N_VARIABLES)),
        np.zeros((N_VARIABLES, N_VARIABLES)),
        np.zeros((THRUST, THRUST)),
        np.zeros((6, 3)),
        np.zeros(_N + 4),
        np.zeros((3, field_width)),
        np.zeros((18, N_VARIABLES)),
    )


@compiled
def differentiate(
    model: ForceModel,
    plan: Plan,
    z: Array,
    arc: int,
    times: tuple[float, float],
    sides: Array,
    transition: Array,
    by_control: Array,
    rates: Array,
    trail: Array,
    costate: Array,
    desk: Desk,
) -> None:
    """Write first and second derivatives of an arc's end, and take the costate from its end to its start.

    Parameters
    ----------
    model, plan, z
        As for `core.transcription.evaluate.evaluate`.
    arc : int
        Number of the arc [-].
    times : (2,) tuple
        Its start and end [TU].
    sides : (2, 7) array
        States there [LU, VU, MU].
    transition, by_control, rates
        As `core.transcription.evaluate` has written them.
    trail : (n, TRAIL_WIDTH) array
        The stages of the arc.
    costate : (7,) array
        Weights of the end state; on return those of the start state.
    desk : Desk
        Its `first` and `second` are the result.
    """
    index = plan.arc_control[arc]
    control = z[index : index + 3] if index >= 0 else plan.arc_fixed[arc]
    is_vector = index >= 0 and plan.has_thrust_vectors
    most, rate = model.max_thrust, model.max_thrust / model.exhaust_velocity
    push_of(is_vector, control, most, rate, desk.thrust, desk.d_thrust, desk.d_rate)
    push_bend_of(is_vector, control, most, rate, desk.dd_thrust, desk.dd_rate)
    _first(transition, by_control, rates, desk.first)
    _by_end(model, times[1], sides[1], costate, desk)
    mass_costate = costate[6]
    _to_start(transition, costate, desk.sums[0])
    bend_along(model.gm, trail, costate, sides[0, 6], -rates[0, 6], desk.bend, desk.moments)
    for i in range(START_AT):
        for j in range(START_AT):
            desk.second[i, j] = desk.bend[1 + i, 1 + j]
    _by_thrust(mass_costate * (times[1] - times[0]), desk)
    _by_start(model, times[0], sides[0], rates[0], costate, desk)


@compiled
def _first(transition: Array, by_control: Array, rates: Array, first: Array) -> None:
    """Write d end / d (y_a, u, t_a, t_b), eq. 9."""
    for i in range(_N):
        total = 0.0
        for j in range(_N):
            first[i, j] = transition[i, j]
            total -= transition[i, j] * rates[0, j]
        for j in range(3):
            first[i, CONTROL_AT + j] = by_control[i, j]
        first[i, START_AT] = total
        first[i, END_AT] = rates[1, i]


@compiled
def _to_start(transition: Array, costate: Array, sums: Array) -> None:
    for j in range(_N):
        sums[j] = 0.0
        for i in range(_N):
            sums[j] += costate[i] * transition[i, j]
    for j in range(_N):
        costate[j] = sums[j]


@compiled
def _pull(model: ForceModel, t: float, state: Array, costate: Array, desk: Desk) -> None:
    """Write the derivatives of costate . F by y, u and t at one end of an arc, eqs. 4 and 5."""
    field, pull, thrust = desk.field, desk.pull, desk.thrust
    states(model.field, t, field)
    x, y, z = state[0], state[1], state[2]
    lx, ly, lz = costate[3], costate[4], costate[5]
    xx, xy, xz, yy, yz, zz = gravity_gradient(model.gm, field[0], x, y, z)
    ax, ay, az = gravity_rate(model.gm, field[0], field[1], x, y, z)
    pull[0] = xx * lx + xy * ly + xz * lz
    pull[1] = xy * lx + yy * ly + yz * lz
    pull[2] = xz * lx + yz * ly + zz * lz
    for i in range(3):
        pull[3 + i] = costate[i]
    inverse = 1.0 / state[6]
    pull[6] = -inverse * inverse * (lx * thrust[0] + ly * thrust[1] + lz * thrust[2])
    for j in range(3):
        slope = desk.d_thrust[j]
        along = lx * slope[0] + ly * slope[1] + lz * slope[2]
        pull[_N + j] = inverse * along - desk.d_rate[j] * costate[6]
    pull[_N + 3] = lx * ax + ly * ay + lz * az


@compiled
def _by_end(model: ForceModel, t: float, state: Array, costate: Array, desk: Desk) -> None:
    """Write the row of t_b, eq. 31: the costate is that of the end."""
    _pull(model, t, state, costate, desk)
    for j in range(N_VARIABLES):
        total = 0.0
        for i in range(_N):
            total += desk.pull[i] * desk.first[i, j]
        desk.second[END_AT, j] = total
    for j in range(3):
        desk.second[END_AT, CONTROL_AT + j] += desk.pull[_N + j]
    desk.second[END_AT, END_AT] += desk.pull[_N + 3]


@compiled
def _by_start(model: ForceModel, t: float, state: Array, rate: Array, costate: Array, desk: Desk) -> None:
    """Write the row of t_a up to its diagonal, eq. 32: the costate is that of the start."""
    _pull(model, t, state, costate, desk)
    last = -desk.pull[_N + 3]
    for j in range(START_AT):
        total = -desk.pull[j]
        for i in range(_N):
            total -= desk.second[j, i] * rate[i]
        desk.second[START_AT, j] = total
        if j < _N:
            last -= total * rate[j]
    desk.second[START_AT, START_AT] = last


@compiled
def _by_thrust(burnt: float, desk: Desk) -> None:
    """Add what the thrust bends in mass and control, eq. 30; burnt is the mass costate times t_b - t_a."""
    second, moments, thrust, d_rate = desk.second, desk.moments, desk.thrust, desk.d_rate
    by_t2 = _dot(thrust, moments[2])
    by_t3, by_t4, by_t5 = _dot(thrust, moments[3]), _dot(thrust, moments[4]), _dot(thrust, moments[5])
    second[6, 6] += 2.0 * by_t3
    for j in range(3):
        slope, row = desk.d_thrust[j], CONTROL_AT + j
        second[row, 6] -= _dot(slope, moments[1]) + 2.0 * by_t4 * d_rate[j]
        for k in range(j + 1):
            crossed = _dot(slope, moments[2]) * d_rate[k] + _dot(desk.d_thrust[k], moments[2]) * d_rate[j]
            curved = _dot(desk.dd_thrust[j, k], moments[0]) + (by_t2 - burnt) * desk.dd_rate[j, k]
            second[row, CONTROL_AT + k] += crossed + curved + 2.0 * by_t5 * d_rate[j] * d_rate[k]


@compiled
def _dot(a: Array, b: Array) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
