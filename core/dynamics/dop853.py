"""Compiled adaptive DOP853 for one arc: constant thrust, linear mass, gravity of four bodies.

The force does not depend on the velocity, so the stages carry positions and accelerations only
(`core.dynamics.tableau`).  One kernel integrates the state alone or with its variational equations; the
columns of its arrays are: state, then d/dr0 (3), d/dv0 (3), d/dm0, and d/du (3).  The step is
controlled by the state, and the partials are those of the steps taken.
"""

import numpy as np

from core.dynamics import tableau
from core.dynamics.force import Array, ForceModel, acceleration, gravity_gradient
from core.ephemeris import positions
from core.jit import compiled

_STAGES = tableau.N_STAGES
_C, _A, _B, _E5, _E3 = (
    tableau.C,
    tableau.A_POSITION,
    tableau.B_POSITION,
    tableau.E5_POSITION,
    tableau.E3_POSITION,
)
_BV, _E5V, _E3V = tableau.B, tableau.E5, tableau.E3

#: Columns: the state alone; with the partials by the start state; with those by the control too.
STATE, COAST, THRUST = 1, 8, 11

#: Results of an integration that could not be finished.
TOO_MANY_STEPS, NOT_FINITE = -1, -2

_MAX_STEPS = 2000
_SAFETY, _SHRINK, _GROW = 0.9, 0.2, 6.0
# First step over the free-fall time at tolerance 1; measured, see docs/decisions/0002-integrator.md.
_FIRST_STEP = 9.0


@compiled
def propagate(
    model: ForceModel,
    t_a: float,
    t_b: float,
    mass: float,
    thrust: Array,
    mass_rate: float,
    d_thrust: Array,
    d_mass_rate: Array,
    tolerance: float,
    r: Array,
    v: Array,
    ends: Array,
    work: Array,
) -> int:
    """Integrate one arc in place, forwards or backwards in time.

    Parameters
    ----------
    model : ForceModel
        Forces; its table must cover the arc, else the result is NOT_FINITE.
    t_a, t_b : float
        Start and end of the arc [TU].
    mass : float
        Mass at t_a [MU].
    thrust : (3,) array
        Constant thrust vector [MU LU/TU^2].
    mass_rate : float
        Mass lost per unit time [MU/TU].
    d_thrust : (3, 3) array
        d thrust / d control, one row per control.
    d_mass_rate : (3,) array
        d mass_rate / d control.
    tolerance : float
        Bound on the estimated error of a step, relative and absolute [LU, VU].
    r, v : (3, STATE or COAST or THRUST) arrays
        Columns at t_a on entry, at t_b on return.
    ends : (2, 3) array
        Total acceleration of the state at t_a and t_b [LU/TU^2].
    work : (16, 3, >= columns) array
        Scratch space.

    Returns
    -------
    int
        Steps taken, or TOO_MANY_STEPS or NOT_FINITE.

    References
    ----------
    docs/method.md, eqs. 2-5; Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.5.
    """
    width = r.shape[1]
    bodies = np.empty(model.bodies.coefficients.shape[2])
    gradient = np.empty(6)
    place, r_new, v_new = work[13], work[14], work[15]
    span = t_b - t_a
    _copy(r, place)
    positions(model.bodies, t_a, bodies)
    _rates(
        model.gm, bodies, place, 0.0, mass, thrust, mass_rate, d_thrust, d_mass_rate, gradient, work[0], width
    )
    ends[0] = work[0][:, 0]
    ends[1] = work[0][:, 0]
    if span == 0.0:
        return 0
    h = min(_first_step(model.gm, bodies, r, tolerance), abs(span))
    t, taken = 0.0, 0
    for _ in range(_MAX_STEPS):
        left = abs(span) - t
        last = h >= left * (1.0 - 1e-12)
        # Two equal steps rather than a long and a short one.
        size = left if last else min(h, 0.5 * left) if h > 0.5 * left else h
        step = size if span > 0 else -size
        elapsed = t if span > 0 else -t
        for s in range(1, _STAGES):
            _stage_position(s, step, r, v, work, place, width)
            at = elapsed + _C[s] * step
            positions(model.bodies, t_a + at, bodies)
            _rates(
                model.gm,
                bodies,
                place,
                at,
                mass,
                thrust,
                mass_rate,
                d_thrust,
                d_mass_rate,
                gradient,
                work[s],
                width,
            )
        _finish(step, r, v, work, r_new, v_new, width)
        error = _error(step, r, v, r_new, v_new, work, tolerance)
        if not np.isfinite(error):
            return NOT_FINITE
        if error <= 1.0:
            t = abs(span) if last else t + size
            taken += 1
            _copy(r_new, r)
            _copy(v_new, v)
            at = span if last else (t if span > 0 else -t)
            positions(model.bodies, t_a + at, bodies)
            _rates(
                model.gm,
                bodies,
                r,
                at,
                mass,
                thrust,
                mass_rate,
                d_thrust,
                d_mass_rate,
                gradient,
                work[0],
                width,
            )
            if last:
                ends[1] = work[0][:, 0]
                return taken
        factor = _SAFETY * error ** (-0.125) if error > 0.0 else _GROW
        h = size * min(_GROW, max(_SHRINK, factor))
    return TOO_MANY_STEPS


@compiled
def _copy(source: Array, target: Array) -> None:
    for i in range(3):
        for j in range(min(source.shape[1], target.shape[1])):
            target[i, j] = source[i, j]


@compiled
def _first_step(gm: Array, bodies: Array, r: Array, tolerance: float) -> float:
    """Scale the free-fall time to the nearer of Earth and Moon to the tolerance of an order-8 method."""
    to_earth = (r[0, 0] ** 2 + r[1, 0] ** 2 + r[2, 0] ** 2) ** 1.5 / gm[0]
    dx, dy, dz = r[0, 0] - bodies[0], r[1, 0] - bodies[1], r[2, 0] - bodies[2]
    to_moon = (dx * dx + dy * dy + dz * dz) ** 1.5 / gm[1]
    return float(_FIRST_STEP * min(to_earth, to_moon) ** 0.5 * tolerance**0.125)


@compiled
def _stage_position(s: int, h: float, r: Array, v: Array, work: Array, place: Array, width: int) -> None:
    for i in range(3):
        for q in range(width):
            place[i, q] = r[i, q] + _C[s] * h * v[i, q]
    for p in range(s):
        factor = h * h * _A[s, p]
        if factor != 0.0:
            for i in range(3):
                for q in range(width):
                    place[i, q] += factor * work[p, i, q]


@compiled
def _finish(h: float, r: Array, v: Array, work: Array, r_new: Array, v_new: Array, width: int) -> None:
    for i in range(3):
        for q in range(width):
            r_new[i, q] = r[i, q] + h * v[i, q]
            v_new[i, q] = v[i, q]
    for p in range(_STAGES):
        by_position, by_velocity = h * h * _B[p], h * _BV[p]
        if by_position != 0.0 or by_velocity != 0.0:
            for i in range(3):
                for q in range(width):
                    r_new[i, q] += by_position * work[p, i, q]
                    v_new[i, q] += by_velocity * work[p, i, q]


@compiled
def _error(h: float, r: Array, v: Array, r_new: Array, v_new: Array, work: Array, tolerance: float) -> float:
    """Return the error of the state over its bound, combined from orders 5 and 3 as DOP853 does."""
    sum5, sum3 = 0.0, 0.0
    for i in range(3):
        r5, r3, v5, v3 = 0.0, 0.0, 0.0, 0.0
        for p in range(_STAGES):
            a = work[p, i, 0]
            r5 += _E5[p] * a
            r3 += _E3[p] * a
            v5 += _E5V[p] * a
            v3 += _E3V[p] * a
        scale_r = tolerance * (1.0 + max(abs(r[i, 0]), abs(r_new[i, 0])))
        scale_v = tolerance * (1.0 + max(abs(v[i, 0]), abs(v_new[i, 0])))
        sum5 += (h * r5 / scale_r) ** 2 + (v5 / scale_v) ** 2
        sum3 += (h * r3 / scale_r) ** 2 + (v3 / scale_v) ** 2
    if sum5 == 0.0 and sum3 == 0.0:
        return 0.0
    return float(abs(h) * sum5 / np.sqrt((sum5 + 0.01 * sum3) * 6.0))


@compiled
def _rates(
    gm: Array,
    bodies: Array,
    r: Array,
    elapsed: float,
    mass: float,
    thrust: Array,
    mass_rate: float,
    d_thrust: Array,
    d_mass_rate: Array,
    gradient: Array,
    out: Array,
    width: int,
) -> None:
    """Write the accelerations of all columns at one moment, docs/method.md eqs. 2, 4 and 5."""
    inverse = 1.0 / (mass - mass_rate * elapsed)
    acceleration(gm, bodies, r[:, 0], out[:, 0])
    if width > STATE:
        gravity_gradient(gm, bodies, r[:, 0], gradient)
        xx, xy, xz, yy, yz, zz = gradient[0], gradient[1], gradient[2], gradient[3], gradient[4], gradient[5]
        for q in range(1, width):
            x, y, z = r[0, q], r[1, q], r[2, q]
            out[0, q] = xx * x + xy * y + xz * z
            out[1, q] = xy * x + yy * y + yz * z
            out[2, q] = xz * x + yz * y + zz * z
    for i in range(3):
        out[i, 0] += thrust[i] * inverse
        if width >= COAST:
            out[i, 7] -= thrust[i] * inverse * inverse
        if width == THRUST:
            for j in range(3):
                # The mass has lost d_mass_rate * elapsed more per unit of control j.
                by_mass = thrust[i] * inverse * inverse * d_mass_rate[j] * elapsed
                out[i, 8 + j] += d_thrust[j, i] * inverse + by_mass
