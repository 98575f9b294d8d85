"""Compiled evaluation of a plan: defects, and the values of their sparse Jacobian.

Everything is canonical.  States are (r, v, m); partials of a leg's end are columns in the order: six time
variables, what the leg starts from, controls of its segments.
"""

import numpy as np
from numpy.typing import NDArray

from core.dynamics import STATE as STATE_ONLY
from core.dynamics import THRUST, ForceModel, fall, integrate, no_trail
from core.ephemeris import EphemerisTable, states
from core.jit import compiled
from core.transcription.control import push_of
from core.transcription.plan import DEPARTURE, N_TIMES, NODE, PARENT, TARGET, Plan

Array = NDArray[np.float64]
_N = 7


@compiled
def evaluate(
    model: ForceModel,
    target: EphemerisTable,
    departure: Array,
    plan: Plan,
    z: Array,
    tolerance: float,
    lift: bool,
    with_partials: bool,
    ends: Array,
    defects: Array,
    values: Array,
) -> int:
    """Propagate every leg and write defects, and on request their partials.

    Parameters
    ----------
    model, target : ForceModel, EphemerisTable
        Forces, and positions of the target relative to the Moon.
    departure : (7,) array
        State at the departure epoch [LU, VU, MU].
    plan : Plan
        What to evaluate.
    z : (n_variables,) array
        Canonical variables; with `lift` nodes that are NaN are written: each gets the end of the leg before.
    tolerance : float
        Of the integrator [-].
    lift, with_partials : bool
        Whether to initialise the nodes, and whether to fill `values`.
    ends : (n_legs, 7) array
        Ends of the legs [LU, VU, MU], written.
    defects : (7 n_blocks,) array
        Earlier side minus later side [LU, VU, MU], written.
    values : (n_values,) array
        Dense blocks, see `Structure.places`, written.

    Returns
    -------
    int
        Accepted integration steps, or the negative status of the arc that failed.
    """
    columns = np.zeros((_N, plan.leg_columns[-1] if with_partials else 0))
    width = THRUST if with_partials else STATE_ONLY
    r, v, work = np.zeros((3, width)), np.zeros((3, width)), np.zeros((16, 3, width))
    accelerations = np.zeros((2, 3))
    thrust, d_thrust, d_rate = np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    most = np.max(plan.leg_arcs)
    transitions = np.zeros((most, _N, _N))
    by_control = np.zeros((most, _N, 3))
    rates = np.zeros((most, 2, _N))
    d_start, trail = np.zeros(_N), no_trail()
    steps = 0
    for leg in range(plan.leg_start.shape[0]):
        _start_state(model, target, departure, plan, z, leg, ends, d_start)
        for i in range(plan.leg_arcs[leg]):
            arc = plan.leg_first[leg] + i
            taken = _fly_arc(
                model, plan, z, arc, plan.leg_trajectory[leg], tolerance, ends[leg], r, v, work,
                accelerations, thrust, d_thrust, d_rate, transitions[i], by_control[i], rates[i],
                trail,
            )  # fmt: skip
            if taken < 0:
                return taken
            steps += taken
        if lift and plan.leg_node[leg] >= 0 and np.isnan(z[plan.leg_node[leg]]):
            z[plan.leg_node[leg] : plan.leg_node[leg] + _N] = ends[leg]
        if with_partials:
            _leg_partials(plan, leg, transitions, by_control, rates, d_start, columns)
    _defects(plan, z, ends, defects)
    if with_partials:
        _fill(plan, columns, values)
    return steps


@compiled
def _moment(plan: Plan, arc: int, end: int, trajectory: int, z: Array) -> float:
    moment = plan.arc_constant[arc, end]
    for slot in range(N_TIMES):
        if plan.times[trajectory, slot] >= 0:
            moment += plan.arc_times[arc, end, slot] * z[plan.times[trajectory, slot]]
    return float(moment)


@compiled
def _start_state(
    model: ForceModel,
    target: EphemerisTable,
    departure: Array,
    plan: Plan,
    z: Array,
    leg: int,
    ends: Array,
    d_start: Array,
) -> None:
    """Write the state a leg starts from, and its derivative by the arrival time if that is the target."""
    kind, link = plan.leg_start[leg], plan.leg_link[leg]
    d_start[:] = 0.0
    if kind == DEPARTURE:
        ends[leg] = departure
    elif kind == NODE:
        ends[leg] = z[link : link + _N]
    elif kind == PARENT:
        ends[leg] = ends[link]
    else:
        t = _moment(plan, plan.leg_first[leg], 0, plan.leg_trajectory[leg], z)
        moon = np.empty((3, model.bodies.coefficients.shape[2]))
        relative = np.empty((3, target.coefficients.shape[2]))
        states(model.bodies, t, moon)
        states(target, t, relative)
        for i in range(3):
            ends[leg, i] = moon[0, i] + relative[0, i]
            ends[leg, 3 + i] = d_start[i] = moon[1, i] + relative[1, i]
            d_start[3 + i] = moon[2, i] + relative[2, i]
        ends[leg, 6] = z[link]
        if target.is_ballistic:
            # The second derivative of a polynomial is worst where records meet.
            falling = np.empty((2, 3))
            fall(model, t, moon, ends[leg], falling)
            d_start[3:6] = falling[0]


@compiled
def _fly_arc(
    model: ForceModel,
    plan: Plan,
    z: Array,
    arc: int,
    trajectory: int,
    tolerance: float,
    state: Array,
    r: Array,
    v: Array,
    work: Array,
    accelerations: Array,
    thrust: Array,
    d_thrust: Array,
    d_rate: Array,
    transition: Array,
    by_control: Array,
    rates: Array,
    trail: Array,
) -> int:
    """Advance the state over one arc and write its partials, docs/method.md eqs. 9-11."""
    index = plan.arc_control[arc]
    control = z[index : index + 3] if index >= 0 else plan.arc_fixed[arc]
    mass_rate = push_of(
        index >= 0 and plan.has_thrust_vectors, control, model.max_thrust,
        model.max_thrust / model.exhaust_velocity, thrust, d_thrust, d_rate,
    )  # fmt: skip
    width = r.shape[1]
    r[:] = 0.0
    v[:] = 0.0
    for i in range(3):
        r[i, 0], v[i, 0] = state[i], state[3 + i]
        if width > STATE_ONLY:
            r[i, 1 + i] = 1.0
            v[i, 4 + i] = 1.0
            rates[0, i] = state[3 + i]
    t_a, t_b = _moment(plan, arc, 0, trajectory, z), _moment(plan, arc, 1, trajectory, z)
    steps = integrate(
        model, t_a, t_b, state[6], thrust, mass_rate, d_thrust, d_rate, tolerance, r, v, accelerations, work,
        trail,
    )  # fmt: skip
    if steps < 0:
        return int(steps)
    for i in range(3):
        state[i], state[3 + i] = r[i, 0], v[i, 0]
    state[6] -= mass_rate * (t_b - t_a)
    if width > STATE_ONLY:
        for i in range(3):
            rates[0, 3 + i] = accelerations[0, i]
            rates[1, i] = v[i, 0]
            rates[1, 3 + i] = accelerations[1, i]
            for j in range(_N):
                transition[i, j], transition[3 + i, j] = r[i, 1 + j], v[i, 1 + j]
            for j in range(3):
                by_control[i, j], by_control[3 + i, j] = r[i, 8 + j], v[i, 8 + j]
        transition[6] = 0.0
        transition[6, 6] = 1.0
        rates[0, 6] = rates[1, 6] = -mass_rate
        for j in range(3):
            by_control[6, j] = -d_rate[j] * (t_b - t_a)
    return int(steps)


@compiled
def _leg_partials(
    plan: Plan,
    leg: int,
    transitions: Array,
    by_control: Array,
    rates: Array,
    d_start: Array,
    columns: Array,
) -> None:
    """Write the partials of a leg's end: products of transitions from its last arc to its first."""
    first, n_arcs = plan.leg_first[leg], plan.leg_arcs[leg]
    offset, stop = plan.leg_columns[leg], plan.leg_columns[leg + 1]
    rest, product = np.eye(_N), np.empty((_N, _N))
    vector = np.empty(_N)
    column = stop
    for i in range(n_arcs - 1, -1, -1):
        arc = first + i
        if plan.arc_control[arc] >= 0:
            column -= 3
            _multiply(rest, by_control[i], columns[:, column : column + 3])
        _multiply(rest, transitions[i], product)
        for slot in range(N_TIMES):
            k_a, k_b = plan.arc_times[arc, 0, slot], plan.arc_times[arc, 1, slot]
            if k_a != 0.0 or k_b != 0.0:
                for row in range(_N):
                    total = 0.0
                    for j in range(_N):
                        total += k_b * rest[row, j] * rates[i, 1, j] - k_a * product[row, j] * rates[i, 0, j]
                    columns[row, offset + slot] += total
        rest[:] = product
    kind, link = plan.leg_start[leg], plan.leg_link[leg]
    if kind == NODE:
        columns[:, column - _N : column] = rest
    elif kind == TARGET:
        columns[:, column - 1] = rest[:, 6]
        for row in range(_N):
            vector[row] = 0.0
            for j in range(_N):
                vector[row] += rest[row, j] * d_start[j]
        for slot in range(N_TIMES):
            columns[:, offset + slot] += plan.arc_times[first, 0, slot] * vector
    elif kind == PARENT:
        begin, end = plan.leg_columns[link], plan.leg_columns[link + 1]
        before = columns[:, begin:end]
        after = np.empty((_N, end - begin))
        _multiply(rest, before, after)
        columns[:, offset : offset + N_TIMES] += after[:, :N_TIMES]
        columns[:, offset + N_TIMES : column] = after[:, N_TIMES:]


@compiled
def _multiply(a: Array, b: Array, out: Array) -> None:
    for i in range(a.shape[0]):
        for j in range(b.shape[1]):
            out[i, j] = 0.0
        for m in range(a.shape[1]):
            factor = a[i, m]
            for j in range(b.shape[1]):
                out[i, j] += factor * b[m, j]


@compiled
def _defects(plan: Plan, z: Array, ends: Array, defects: Array) -> None:
    for block in range(plan.block_plus.shape[0]):
        plus, minus, node = plan.block_plus[block], plan.block_minus[block], plan.block_node[block]
        for i in range(_N):
            total = 0.0
            if plus >= 0:
                total += ends[plus, i]
            if minus >= 0:
                total -= ends[minus, i]
            if node >= 0:
                total += plan.block_sign[block] * z[node + i]
            defects[_N * block + i] = total


@compiled
def _fill(plan: Plan, columns: Array, values: Array) -> None:
    """Copy the partials of the legs into the dense blocks, row by row."""
    for block in range(plan.block_plus.shape[0]):
        first = plan.block_values[block]
        width = (plan.block_values[block + 1] - first) // _N
        for row in range(_N):
            at = first + row * width
            values[at : at + width] = 0.0
            place = at + N_TIMES
            for leg, sign in ((plan.block_plus[block], 1.0), (plan.block_minus[block], -1.0)):
                if leg >= 0:
                    begin, end = plan.leg_columns[leg], plan.leg_columns[leg + 1]
                    for slot in range(N_TIMES):
                        values[at + slot] += sign * columns[row, begin + slot]
                    for column in range(begin + N_TIMES, end):
                        values[place] = sign * columns[row, column]
                        place += 1
            if plan.block_node[block] >= 0:
                values[place + row] = plan.block_sign[block]
