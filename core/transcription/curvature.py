"""Compiled second derivatives of a plan's defects, weighted with multipliers: docs/method.md, eqs. 25-35.

Legs are propagated forwards; then their matrices, see `core.transcription.plan`, are pulled back from the end
of each arc to its start.  Variables of an arc, in this order: its start state y_a (7), control u (3), t_a,
t_b.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.dynamics import THRUST, ForceModel, fall
from core.dynamics.dop853 import TRAIL_FULL, TRAIL_ROWS, TRAIL_WIDTH, bend_along
from core.dynamics.force import FIELD_WIDTH, gravity_gradient, gravity_rate
from core.ephemeris import EphemerisTable, jerks, states
from core.jit import compiled
from core.transcription.control import push_bend_of, push_of
from core.transcription.evaluate import _fly_arc, _moment, _multiply, _start_state
from core.transcription.plan import FIRST, N_TIMES, PARENT, TARGET, Indices, Pattern, Plan

Array = NDArray[np.float64]
_N = 7

#: Where the control, t_a and t_b stand among the variables of an arc, and their number.
CONTROL_AT, START_AT, END_AT, N_VARIABLES = 7, 10, 11, 12


class Desk(NamedTuple):
    """Workspace for the second derivatives of one arc."""

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
    #: See `core.dynamics.dop853.bend_along`.
    bend: Array
    moments: Array
    #: (11,) weights of F at one end by y, u and t; (3, 16) and (6,) the bodies and the gradient there.
    pull: Array
    field: Array
    #: (18, 12) for sums.
    sums: Array


@compiled
def desk(field_width: int) -> Desk:
    """Return an empty workspace for a force model whose field has that many columns [-]."""
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
    """Add the second derivatives of thrust by mass and control, eq. 30; burnt: mass costate * (t_b - t_a)."""
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


# Steps for which there is room at first: a leg of five segments takes thirty.
_FIRST_STEPS = 128


@compiled
def curvature(
    model: ForceModel,
    target: EphemerisTable,
    departure: Array,
    plan: Plan,
    pattern: Pattern,
    z: Array,
    tolerance: float,
    multipliers: Array,
    values: Array,
) -> int:
    """Propagate every leg and write the Hessian of multipliers . defects.

    Parameters
    ----------
    model, target, departure, plan, z, tolerance
        As for `core.transcription.evaluate.evaluate`.
    pattern : Pattern
        That of the plan.
    multipliers : (7 n_blocks,) array
        Weights of the defects [-].
    values : (n_nonzeros,) array
        Lower triangle at `pattern.rows` and `pattern.columns`, written.

    Returns
    -------
    int
        Accepted integration steps, or the negative status of the arc that failed.
    """
    groups, n_legs = pattern.groups, plan.leg_start.shape[0]
    ends, costates, d_start = np.zeros((n_legs, _N)), np.zeros((n_legs, _N)), np.zeros(_N)
    flight, on = _flight(_most_arcs(plan, groups)), desk(FIELD_WIDTH)
    trail = np.empty((TRAIL_ROWS * _FIRST_STEPS, TRAIL_WIDTH))
    store = np.empty(np.max(pattern.store + pattern.size**2))
    _weigh_ends(plan, multipliers, costates)
    values[:] = 0.0
    steps = 0
    for group in range(groups.shape[0] - 1):
        low, high = groups[group], groups[group + 1]
        for leg in range(low, high):
            _start_state(model, target, departure, plan, z, leg, ends, d_start)
            taken, trail = _fly(
                model, plan, z, leg, plan.leg_first[low], tolerance, ends[leg], flight, on, trail
            )
            if taken < 0:
                return int(taken)
            steps += taken
        store[: pattern.store[high - 1] + pattern.size[high - 1] ** 2] = 0.0
        for leg in range(high - 1, low - 1, -1):
            matrix = _matrix(pattern, leg, store)
            _pull_leg(
                model, plan, pattern, z, leg, plan.leg_first[low], flight, trail, costates[leg], on, matrix
            )
            if plan.leg_start[leg] == PARENT:
                _hand_on(pattern, leg, plan.leg_link[leg], matrix, store, costates)
                continue
            if plan.leg_start[leg] == TARGET:
                _start_state(model, target, departure, plan, z, leg, ends, d_start)
                _from_target(model, target, plan, z, leg, ends[leg], d_start, costates[leg], on, matrix)
            _add_to(pattern, leg, matrix, values)
    return steps


class _Flight(NamedTuple):
    """Stored results of the legs of one group, arc after arc, and scratch space."""

    #: As `core.transcription.evaluate` writes them.
    transitions: Array
    by_control: Array
    rates: Array
    #: (n_arcs, 2, 7) states at both ends; (n_arcs + 1,) first row of each arc in the trail.
    sides: Array
    marks: Indices
    r: Array
    v: Array
    work: Array
    accelerations: Array


@compiled
def _flight(n_arcs: int) -> _Flight:
    return _Flight(
        np.zeros((n_arcs, _N, _N)),
        np.zeros((n_arcs, _N, 3)),
        np.zeros((n_arcs, 2, _N)),
        np.zeros((n_arcs, 2, _N)),
        np.zeros(n_arcs + 1, np.int64),
        np.zeros((3, THRUST)),
        np.zeros((3, THRUST)),
        np.zeros((16, 3, THRUST)),
        np.zeros((2, 3)),
    )


@compiled
def _most_arcs(plan: Plan, groups: Indices) -> int:
    """Return the number of arcs of the longest group."""
    most = 0
    for group in range(groups.shape[0] - 1):
        last = groups[group + 1] - 1
        most = max(most, plan.leg_first[last] + plan.leg_arcs[last] - plan.leg_first[groups[group]])
    return most


@compiled
def _fly(
    model: ForceModel,
    plan: Plan,
    z: Array,
    leg: int,
    origin: int,
    tolerance: float,
    state: Array,
    flight: _Flight,
    on: Desk,
    trail: Array,
) -> tuple[int, Array]:
    """Advance the state over a leg and record it; return steps or a status, and the trail or a longer one."""
    steps, marks, sides = 0, flight.marks, flight.sides
    for arc in range(plan.leg_first[leg], plan.leg_first[leg] + plan.leg_arcs[leg]):
        i, taken = arc - origin, TRAIL_FULL
        sides[i, 0] = state
        while taken == TRAIL_FULL:
            # An empty trail would not be filled, and not be found too short.
            if trail.shape[0] - marks[i] >= TRAIL_ROWS:
                taken = _fly_arc(
                    model, plan, z, arc, plan.leg_trajectory[leg], tolerance, state, flight.r, flight.v,
                    flight.work, flight.accelerations, on.thrust, on.d_thrust, on.d_rate,
                    flight.transitions[i], flight.by_control[i], flight.rates[i], trail[marks[i] :],
                )  # fmt: skip
            if taken == TRAIL_FULL:
                trail = _longer(trail, marks[i])
        if taken < 0:
            return taken, trail
        sides[i, 1] = state
        marks[i + 1] = marks[i] + TRAIL_ROWS * taken
        steps += taken
    return steps, trail


@compiled
def _pull_leg(
    model: ForceModel,
    plan: Plan,
    pattern: Pattern,
    z: Array,
    leg: int,
    origin: int,
    flight: _Flight,
    trail: Array,
    costate: Array,
    on: Desk,
    matrix: Array,
) -> None:
    """Propagate matrix and costate of a leg from its end, where those of its children are, to its start."""
    trajectory, known, marks = plan.leg_trajectory[leg], FIRST + pattern.carried[leg], flight.marks
    for arc in range(plan.leg_first[leg] + plan.leg_arcs[leg] - 1, plan.leg_first[leg] - 1, -1):
        i = arc - origin
        times = _moment(plan, arc, 0, trajectory, z), _moment(plan, arc, 1, trajectory, z)
        differentiate(
            model, plan, z, arc, times, flight.sides[i], flight.transitions[i], flight.by_control[i],
            flight.rates[i], trail[marks[i] : marks[i + 1]], costate, on,
        )  # fmt: skip
        has_control = plan.arc_control[arc] >= 0
        _pull_back(plan.arc_times[arc], has_control, known, on, matrix)
        known += 3 if has_control else 0


@compiled
def _matrix(pattern: Pattern, leg: int, store: Array) -> Array:
    offset, size = pattern.store[leg], pattern.size[leg]
    return store[offset : offset + size * size].reshape(size, size)


@compiled
def _longer(trail: Array, used: int) -> Array:
    longer = np.empty((2 * trail.shape[0], trail.shape[1]))
    longer[:used] = trail[:used]
    return longer


@compiled
def _weigh_ends(plan: Plan, multipliers: Array, costates: Array) -> None:
    """Write the weights of the legs' ends in multipliers . defects, eq. 25."""
    for block in range(plan.block_plus.shape[0]):
        for leg, sign in ((plan.block_plus[block], 1.0), (plan.block_minus[block], -1.0)):
            if leg >= 0:
                for i in range(_N):
                    costates[leg, i] += sign * multipliers[_N * block + i]


@compiled
def _pull_back(moments: Array, has_control: bool, known: int, on: Desk, matrix: Array) -> None:
    """Replace the end of an arc by its variables in the known part of a leg's matrix, eq. 34."""
    first, sums, local = on.first, on.sums, on.second
    _multiply(matrix[:_N, :_N], first, sums[:_N])
    for i in range(N_VARIABLES):
        for m in range(_N):
            factor = first[m, i]
            for j in range(N_VARIABLES):
                local[i, j] += factor * sums[m, j]
    for i in range(_N):
        for j in range(_N):
            matrix[i, j] = local[i, j]
    row = sums[0]
    for n in range(_N, known):
        _multiply(matrix[n : n + 1, :_N], first, sums[:1])
        for j in range(_N):
            matrix[n, j] = row[j]
        if has_control:
            for c in range(3):
                matrix[known + c, n] = row[CONTROL_AT + c]
        for s in range(N_TIMES):
            by = row[START_AT] * moments[0, s] + row[END_AT] * moments[1, s]
            # By times on both sides: the other half follows from symmetry.
            matrix[max(n, _N + s), min(n, _N + s)] += 2.0 * by if n == _N + s else by
    _lay_local(moments, has_control, known, local, matrix)


@compiled
def _lay_local(moments: Array, has_control: bool, known: int, local: Array, matrix: Array) -> None:
    """Add the second derivatives by an arc's own variables, its moments resolved into times."""
    for s in range(N_TIMES):
        k_a, k_b = moments[0, s], moments[1, s]
        if k_a == 0.0 and k_b == 0.0:
            continue
        for j in range(_N):
            matrix[_N + s, j] += k_a * local[START_AT, j] + k_b * local[END_AT, j]
        if has_control:
            for c in range(3):
                at = CONTROL_AT + c
                matrix[known + c, _N + s] += k_a * local[START_AT, at] + k_b * local[END_AT, at]
        for s2 in range(s + 1):
            k2_a, k2_b = moments[0, s2], moments[1, s2]
            crossed = (k_a * k2_b + k_b * k2_a) * local[END_AT, START_AT]
            matrix[_N + s, _N + s2] += (
                k_a * k2_a * local[START_AT, START_AT] + crossed + k_b * k2_b * local[END_AT, END_AT]
            )
    if has_control:
        for c in range(3):
            for j in range(_N):
                matrix[known + c, j] = local[CONTROL_AT + c, j]
            for c2 in range(c + 1):
                matrix[known + c, known + c2] = local[CONTROL_AT + c, CONTROL_AT + c2]


@compiled
def _from_target(
    model: ForceModel,
    target: EphemerisTable,
    plan: Plan,
    z: Array,
    leg: int,
    start: Array,
    d_start: Array,
    costate: Array,
    on: Desk,
    matrix: Array,
) -> None:
    """Replace a start on the target by the time of arrival, eq. 35; the row of the mass remains."""
    arc = plan.leg_first[leg]
    t, times = _moment(plan, arc, 0, plan.leg_trajectory[leg], z), plan.arc_times[arc, 0]
    jerk = _jerk(model, target, t, start)
    slope, by_slope = on.sums[2], on.pull
    twice = 0.0
    for i in range(3):
        # d2 (r, v) / dt2 is acceleration and jerk.
        twice += costate[i] * d_start[3 + i] + costate[3 + i] * jerk[i]
    for i in range(_N):
        by_slope[i] = 0.0
        for j in range(_N):
            by_slope[i] += matrix[i, j] * d_start[j]
        twice += d_start[i] * by_slope[i]
    for n in range(_N, matrix.shape[0]):
        total = 0.0
        for j in range(_N):
            total += matrix[n, j] * d_start[j]
        if n < FIRST:
            slope[n - _N] = total
        else:
            for s in range(N_TIMES):
                matrix[n, _N + s] += times[s] * total
    for s in range(N_TIMES):
        matrix[_N + s, 6] += times[s] * by_slope[6]
        for s2 in range(s + 1):
            matrix[_N + s, _N + s2] += (
                times[s] * times[s2] * twice + times[s] * slope[s2] + slope[s] * times[s2]
            )


@compiled
def _jerk(model: ForceModel, target: EphemerisTable, t: float, state: Array) -> Array:
    """Return the jerk (3,) of the target about the Earth: that of the model where gravity alone moves it."""
    if target.is_ballistic:
        bodies, falling = np.empty((3, model.bodies.coefficients.shape[2])), np.empty((2, 3))
        states(model.bodies, t, bodies)
        fall(model, t, bodies, state, falling)
        own: Array = falling[1]
        return own
    jerk, moon = np.empty(target.coefficients.shape[2]), np.empty(model.bodies.coefficients.shape[2])
    jerks(target, t, jerk)
    jerks(model.bodies, t, moon)
    both: Array = jerk + moon[:3]
    return both


@compiled
def _hand_on(pattern: Pattern, leg: int, parent: int, matrix: Array, store: Array, costates: Array) -> None:
    """Add a child's matrix and costate to those of its parent."""
    shared, into, other = pattern.shared[leg], pattern.into[leg], _matrix(pattern, parent, store)
    for i in range(_N):
        costates[parent, i] += costates[leg, i]
    for i in range(matrix.shape[0]):
        to = i if i < shared else into + i - shared
        for j in range(_N if i < _N else i + 1):
            other[to, j if j < shared else into + j - shared] += matrix[i, j]


@compiled
def _add_to(pattern: Pattern, leg: int, matrix: Array, values: Array) -> None:
    place = pattern.first_place[leg]
    for i in range(matrix.shape[0]):
        for j in range(i + 1):
            if pattern.places[place] >= 0:
                values[pattern.places[place]] += matrix[i, j]
            place += 1
