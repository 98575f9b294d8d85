"""Compiled adaptive DOP853 for one arc: constant thrust, linear mass, gravity of four bodies.

The force does not depend on the velocity, so the stages carry positions and accelerations only
(`core.dynamics.tableau`).  One kernel integrates the state alone or with its variational equations; the
columns of its arrays are: state, then d/dr0 (3), d/dv0 (3), d/dm0, and d/du (3).  The step is
controlled by the state, and the partials are those of the steps taken.

Second derivatives of an arc are a quadrature along its trail, with a costate that needs no equation: weights
l of the end of an arc come in, the Hessian of l . end by (r_a, v_a, m_a, u) goes out.
"""

import numpy as np

from core.dynamics import tableau
from core.dynamics.force import (
    FIELD_WIDTH,
    Array,
    ForceModel,
    field_at,
    gravity,
    gravity_bend,
    gravity_gradient,
)
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
TOO_MANY_STEPS, NOT_FINITE, TRAIL_FULL, BELOW_SURFACE = -1, -2, -3, -4

#: Rows of a trail per step: the stages whose weight of order 8 is not zero.
TRAIL_ROWS = 8
#: Columns of a trail: places of `THRUST` columns, of three bodies, weight, time since t_a.
TRAIL_WIDTH = 3 * THRUST + 11
TRAIL_BODIES, TRAIL_WEIGHT, TRAIL_TIME = TRAIL_WIDTH - 11, TRAIL_WIDTH - 2, TRAIL_WIDTH - 1
# Stages with a weight stand at 0 and, without a gap, from here on.
_WEIGHTED = 5

_MAX_STEPS = 2000
# Measured, as is the first step over the free-fall time at tolerance 1: docs/decisions/0002-integrator.md.
_SAFETY, _SHRINK, _GROW = 0.7, 0.2, 6.0
_FIRST_STEP = 5.0

#: Where the work array holds the place of a stage.
_PLACE = 13


@compiled
def no_trail() -> Array:
    """Return an empty trail for `integrate`, which then records nothing."""
    return np.empty((0, TRAIL_WIDTH))


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
    work : (16, 3, columns) array
        Scratch space.

    Returns
    -------
    int
        Steps taken, or TOO_MANY_STEPS, NOT_FINITE, or BELOW_SURFACE where a step ends below one.

    References
    ----------
    docs/method.md, eqs. 2-5; Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.5.
    """
    return integrate(
        model, t_a, t_b, mass, thrust, mass_rate, d_thrust, d_mass_rate, tolerance, r, v, ends, work,
        no_trail(),
    )  # fmt: skip


@compiled
def integrate(
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
    trail: Array,
) -> int:
    """Propagate as `propagate` does, and record the stages for quadratures along the arc.

    Parameters
    ----------
    model, t_a, t_b, mass, thrust, mass_rate, d_thrust, d_mass_rate, tolerance, r, v, ends, work
        As for `propagate`.
    trail : (n, TRAIL_WIDTH) array
        Written, `TRAIL_ROWS` per step, if r has `THRUST` columns: places of the columns, x y z of each
        [LU per unit of the column], places of the bodies [LU], weight and time since t_a [TU].  Without
        rows nothing is recorded; with too few the result is TRAIL_FULL.
    """
    span = t_b - t_a
    has_trail = trail.shape[0] > 0
    width = r.shape[1]
    flat_r, flat_v, flat_work = r.reshape(3 * width), v.reshape(3 * width), work.reshape(16, 3 * width)
    field = np.empty(FIELD_WIDTH)
    gm, coefficients = model.gm, model.field.coefficients
    start, record = model.field.start, model.field.record
    field_at(start, record, coefficients, t_a, field)
    _stay(r, work)
    _gravitate(gm, field, work, 0)
    _push(0.0, mass, thrust, mass_rate, d_thrust, d_mass_rate, work, 0)
    for i in range(3):
        ends[0, i] = ends[1, i] = work[0, i, 0]
    if span == 0.0:
        return 0
    if has_trail:
        if trail.shape[0] < TRAIL_ROWS:
            return TRAIL_FULL
        _record(field, work, trail[0])
    h = min(_first_step(gm, field, r, tolerance), abs(span))
    t, taken = 0.0, 0
    for _ in range(_MAX_STEPS):
        left = abs(span) - t
        last = h >= left * (1.0 - 1e-12)
        # Two equal steps rather than a long and a short one.
        size = left if last else min(h, 0.5 * left) if h > 0.5 * left else h
        step = size if span > 0 else -size
        elapsed = t if span > 0 else -t
        for s in range(1, _STAGES):
            at = elapsed + _C[s] * step
            field_at(start, record, coefficients, t_a + at, field)
            if width > STATE:
                _stage_place(s, step, flat_r, flat_v, flat_work)
            _state_place(s, step, r, v, work)
            _gravitate(gm, field, work, s)
            _push(at, mass, thrust, mass_rate, d_thrust, d_mass_rate, work, s)
            if has_trail and s >= _WEIGHTED:
                _record(field, work, trail[TRAIL_ROWS * taken + 1 + s - _WEIGHTED])
        error = _error(step, r, v, work, tolerance)
        if not np.isfinite(error):
            return NOT_FINITE
        if error <= 1.0:
            if has_trail:
                _weigh(elapsed, step, trail[TRAIL_ROWS * taken : TRAIL_ROWS * (taken + 1)])
            t = abs(span) if last else t + size
            taken += 1
            _advance(step, flat_r, flat_v, flat_work)
            at = span if last else (t if span > 0 else -t)
            field_at(start, record, coefficients, t_a + at, field)
            if _is_below(model.surfaces, r, field):
                return BELOW_SURFACE
            _stay(r, work)
            _gravitate(gm, field, work, 0)
            _push(at, mass, thrust, mass_rate, d_thrust, d_mass_rate, work, 0)
            if last:
                for i in range(3):
                    ends[1, i] = work[0, i, 0]
                return taken
            if has_trail:
                if trail.shape[0] < TRAIL_ROWS * (taken + 1):
                    return TRAIL_FULL
                _record(field, work, trail[TRAIL_ROWS * taken])
        factor = _SAFETY * error ** (-0.125) if error > 0.0 else _GROW
        h = size * min(_GROW, max(_SHRINK, factor))
    return TOO_MANY_STEPS


@compiled
def _is_below(surfaces: Array, r: Array, field: Array) -> bool:
    """Return whether a state lies below the surface of Earth or Moon."""
    from_earth = from_moon = 0.0
    for i in range(3):
        from_earth += r[i, 0] * r[i, 0]
        from_moon += (r[i, 0] - field[i]) * (r[i, 0] - field[i])
    return bool(from_earth < surfaces[0] * surfaces[0] or from_moon < surfaces[1] * surfaces[1])


@compiled
def _record(field: Array, work: Array, row: Array) -> None:
    """Write the positions of columns and bodies at a stage."""
    for i in range(3):
        for q in range(THRUST):
            row[THRUST * i + q] = work[_PLACE, i, q]
    for i in range(9):
        row[TRAIL_BODIES + i] = field[i]


@compiled
def _weigh(elapsed: float, step: float, rows: Array) -> None:
    """Write weights and times of the stages of an accepted step."""
    for k in range(TRAIL_ROWS):
        s = 0 if k == 0 else _WEIGHTED + k - 1
        rows[k, TRAIL_WEIGHT] = step * _BV[s]
        rows[k, TRAIL_TIME] = elapsed + _C[s] * step


@compiled
def _first_step(gm: Array, field: Array, r: Array, tolerance: float) -> float:
    """Scale the free-fall time to the nearer of Earth and Moon to the tolerance of an order-8 method."""
    to_earth = (r[0, 0] ** 2 + r[1, 0] ** 2 + r[2, 0] ** 2) ** 1.5 / gm[0]
    dx, dy, dz = r[0, 0] - field[0], r[1, 0] - field[1], r[2, 0] - field[2]
    to_moon = (dx * dx + dy * dy + dz * dz) ** 1.5 / gm[1]
    return float(_FIRST_STEP * min(to_earth, to_moon) ** 0.5 * tolerance**0.125)


@compiled
def _stay(r: Array, work: Array) -> None:
    """Set the first stage's positions to those at the beginning of the step."""
    for i in range(3):
        for q in range(r.shape[1]):
            work[_PLACE, i, q] = r[i, q]


@compiled
def _stage_place(s: int, h: float, r: Array, v: Array, work: Array) -> None:
    """Write the positions of all columns at a stage; the arrays are flat, so that loops vectorize."""
    for q in range(r.shape[0]):
        work[_PLACE, q] = r[q] + _C[s] * h * v[q]
    for p in range(s):
        factor = h * h * _A[s, p]
        if factor != 0.0:
            for q in range(r.shape[0]):
                work[_PLACE, q] += factor * work[p, q]


@compiled
def _state_place(s: int, h: float, r: Array, v: Array, work: Array) -> None:
    """Do the same for the state alone, which stays in registers."""
    x, y, z = 0.0, 0.0, 0.0
    for p in range(s):
        weight = _A[s, p]
        x += weight * work[p, 0, 0]
        y += weight * work[p, 1, 0]
        z += weight * work[p, 2, 0]
    work[_PLACE, 0, 0] = r[0, 0] + h * (_C[s] * v[0, 0] + h * x)
    work[_PLACE, 1, 0] = r[1, 0] + h * (_C[s] * v[1, 0] + h * y)
    work[_PLACE, 2, 0] = r[2, 0] + h * (_C[s] * v[2, 0] + h * z)


@compiled
def _gravitate(gm: Array, field: Array, work: Array, s: int) -> None:
    """Write the accelerations of all columns by gravity at one moment, docs/method.md eqs. 2 and 4."""
    x, y, z = work[_PLACE, 0, 0], work[_PLACE, 1, 0], work[_PLACE, 2, 0]
    ax, ay, az = gravity(gm, field, x, y, z)
    if work.shape[2] > STATE:
        xx, xy, xz, yy, yz, zz = gravity_gradient(gm, field, x, y, z)
        for q in range(work.shape[2]):
            x, y, z = work[_PLACE, 0, q], work[_PLACE, 1, q], work[_PLACE, 2, q]
            work[s, 0, q] = xx * x + xy * y + xz * z
            work[s, 1, q] = xy * x + yy * y + yz * z
            work[s, 2, q] = xz * x + yz * y + zz * z
    work[s, 0, 0], work[s, 1, 0], work[s, 2, 0] = ax, ay, az


@compiled
def _push(
    at: float,
    mass: float,
    thrust: Array,
    mass_rate: float,
    d_thrust: Array,
    d_mass_rate: Array,
    work: Array,
    s: int,
) -> None:
    """Add the accelerations of all columns by the thrust, docs/method.md eq. 5."""
    inverse = 1.0 / (mass - mass_rate * at)
    width = work.shape[2]
    for i in range(3):
        work[s, i, 0] += thrust[i] * inverse
    if width > STATE:
        for i in range(3):
            work[s, i, 7] -= thrust[i] * inverse * inverse
    if width == THRUST:
        for j in range(3):
            # The mass has lost d_mass_rate * elapsed more per unit of control j.
            by_mass = inverse * inverse * d_mass_rate[j] * at
            for i in range(3):
                work[s, i, 8 + j] += d_thrust[j, i] * inverse + thrust[i] * by_mass


@compiled
def _error(h: float, r: Array, v: Array, work: Array, tolerance: float) -> float:
    """Return the error of the state over its bound, combined from orders 5 and 3 as DOP853 does."""
    sum5, sum3 = 0.0, 0.0
    for i in range(3):
        r_new, v_new = 0.0, 0.0
        r5, r3, v5, v3 = 0.0, 0.0, 0.0, 0.0
        for p in range(_STAGES):
            a = work[p, i, 0]
            r_new += _B[p] * a
            v_new += _BV[p] * a
            r5 += _E5[p] * a
            r3 += _E3[p] * a
            v5 += _E5V[p] * a
            v3 += _E3V[p] * a
        r_new = r[i, 0] + h * (v[i, 0] + h * r_new)
        v_new = v[i, 0] + h * v_new
        scale_r = tolerance * (1.0 + max(abs(r[i, 0]), abs(r_new)))
        scale_v = tolerance * (1.0 + max(abs(v[i, 0]), abs(v_new)))
        sum5 += (h * r5 / scale_r) ** 2 + (v5 / scale_v) ** 2
        sum3 += (h * r3 / scale_r) ** 2 + (v3 / scale_v) ** 2
    if sum5 == 0.0 and sum3 == 0.0:
        return 0.0
    return float(abs(h) * sum5 / np.sqrt((sum5 + 0.01 * sum3) * 6.0))


@compiled
def _advance(h: float, r: Array, v: Array, work: Array) -> None:
    """Take the step in all columns of the flat arrays."""
    for q in range(r.shape[0]):
        r[q] += h * v[q]
    for p in range(_STAGES):
        by_position, by_velocity = h * h * _B[p], h * _BV[p]
        if by_position != 0.0 or by_velocity != 0.0:
            for q in range(r.shape[0]):
                r[q] += by_position * work[p, q]
            for q in range(r.shape[0]):
                v[q] += by_velocity * work[p, q]


#: Moments of the costate along an arc: sum of l_v t^j / m^i for (i, j) in this order.
MOMENTS = ((1, 0), (2, 0), (2, 1), (3, 0), (3, 1), (3, 2))


@compiled
def bend_along(
    gm: Array,
    trail: Array,
    costate: Array,
    mass: float,
    mass_rate: float,
    bend: Array,
    moments: Array,
) -> None:
    """Integrate the second derivatives of gravity and thrust, docs/method.md eqs. 26-29.

    Parameters
    ----------
    gm : (4,) array
        Gravitational parameters [LU^3/TU^2].
    trail : (n, TRAIL_WIDTH) array
        The stages of the arc, see `core.dynamics.dop853.integrate`.
    costate : (7,) array
        Weights l at t_a of r, v and m.
    mass, mass_rate : float
        Mass at t_a [MU] and its loss per unit time [MU/TU].
    bend : (THRUST, THRUST) array
        Sum of Psi^T (d2 (l_v . gravity) / d r2) Psi, written; rows and columns as those of a trail, lower
        triangle from row and column 1 on.
    moments : (6, 3) array
        Integrals of l_v t^j / m^i, see `MOMENTS`, written.
    """
    bend[:] = 0.0
    moments[:] = 0.0
    turned = np.empty((3, THRUST))
    l_r, l_v = costate[:3], costate[3:6]
    for k in range(trail.shape[0]):
        row = trail[k]
        weight = row[TRAIL_WEIGHT]
        lx, ly, lz = _costate(row, 0, l_r, l_v), _costate(row, 1, l_r, l_v), _costate(row, 2, l_r, l_v)
        lx, ly, lz = weight * lx, weight * ly, weight * lz
        _add_moments(row[TRAIL_TIME], mass - mass_rate * row[TRAIL_TIME], lx, ly, lz, moments)
        xx, xy, xz, yy, yz, zz = gravity_bend(
            gm, row[TRAIL_BODIES:], row[0], row[THRUST], row[2 * THRUST], lx, ly, lz
        )
        for q in range(THRUST):
            x, y, z = row[q], row[THRUST + q], row[2 * THRUST + q]
            turned[0, q] = xx * x + xy * y + xz * z
            turned[1, q] = xy * x + yy * y + yz * z
            turned[2, q] = xz * x + yz * y + zz * z
        for p in range(1, THRUST):
            x, y, z = row[p], row[THRUST + p], row[2 * THRUST + p]
            for q in range(THRUST):
                bend[p, q] += x * turned[0, q] + y * turned[1, q] + z * turned[2, q]


@compiled
def _costate(row: Array, i: int, l_r: Array, l_v: Array) -> float:
    """Return component i of l_v at a stage; eq. 27, from the symmetry of gravity's gradient."""
    at = THRUST * i + 1
    total = 0.0
    for j in range(3):
        total += row[at + j] * l_v[j] - row[at + 3 + j] * l_r[j]
    return total


@compiled
def _add_moments(t: float, mass: float, lx: float, ly: float, lz: float, moments: Array) -> None:
    inverse = 1.0 / mass
    square = inverse * inverse
    cube = square * inverse
    factors = (inverse, square, square * t, cube, cube * t, cube * t * t)
    for n in range(6):
        moments[n, 0] += factors[n] * lx
        moments[n, 1] += factors[n] * ly
        moments[n, 2] += factors[n] * lz
