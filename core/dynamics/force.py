"""Point-mass gravity of the centre and of up to three bodies on the spacecraft, with its gradient.

Frame: origin at the centre of the world, axes J2000.  Units: canonical; times in TU past the departure epoch.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.constants import G0
from core.ephemeris import EphemerisTable, coefficients_through, values_at_nodes
from core.jit import compiled
from core.problem import Problem
from core.world import MOST_BODIES, World, world_of

Array = NDArray[np.float64]

#: Columns of a `field_table`.
FIELD_WIDTH = 16


class ForceModel(NamedTuple):
    """The data of the equations of motion, in a form that compiled code accepts."""

    #: (4,) gravitational parameters of the centre and of three bodies [LU^3/TU^2].
    gm: Array
    #: Thrust at throttle 1 [MU LU/TU^2].
    max_thrust: float
    #: Exhaust velocity [LU/TU].
    exhaust_velocity: float
    #: Positions of the three bodies.
    bodies: EphemerisTable
    #: Those and the centre's fall, see `field_table`.
    field: EphemerisTable
    #: (2,) distances from centre and first body below which no path may lead [LU]; zeros let all pass.
    surfaces: Array


def force_model(problem: Problem, bodies: EphemerisTable) -> ForceModel:
    """Return the force model of a problem over the span of an ephemeris table."""
    craft, world = problem.spacecraft, world_of(problem)
    gm = gm_of(world)
    return ForceModel(
        gm=gm,
        max_thrust=world.units.thrust(craft.max_thrust_n),
        exhaust_velocity=world.units.exhaust_velocity(craft.isp_s, G0),
        bodies=bodies,
        field=field_table(gm, bodies),
        surfaces=np.zeros(2),
    )


def gm_of(world: World) -> Array:
    """Return the gravitational parameters (4,) of a world's centre and bodies, 0 where it has fewer."""
    gm = np.zeros(1 + MOST_BODIES)
    for place, body in enumerate((world.center, *world.bodies)):
        gm[place] = world.units.gm(body.gm_km3_s2)
    return gm


def field_table(gm: Array, bodies: EphemerisTable) -> EphemerisTable:
    """Return a table of bodies with three columns more: how they accelerate the centre.

    The fall of the centre depends on time alone, and a polynomial costs a tenth of its three roots.  Columns
    of zeros follow: compilers vectorize no loop that is shorter than 16.

    Parameters
    ----------
    gm : (4,) array
        Gravitational parameters of the centre and of three bodies [LU^3/TU^2].
    bodies : EphemerisTable
        Positions of the three bodies [LU].
    """
    places = values_at_nodes(bodies)
    apart = places.reshape(*places.shape[:2], 3, 3)
    distances = np.linalg.norm(apart, axis=3, keepdims=True)
    # What does not pull has its place at the centre.
    distances[distances == 0.0] = np.inf
    pulls = gm[1:, None] * apart / distances**3
    falls = coefficients_through(pulls.sum(axis=2))
    rest = np.zeros((*falls.shape[:2], FIELD_WIDTH - 12))
    columns = np.concatenate([bodies.coefficients, falls, rest], axis=2)
    return bodies._replace(coefficients=columns)


@compiled
def field_at(start: float, record: float, c: Array, t: float, out: Array) -> None:
    """Write a row of a `field_table` at t; NaN outside its span.

    It is called ten times a step, hence the terms in one expression, and the table in pieces: to take an
    array out of a tuple counts its references.

    Parameters
    ----------
    start, record : float
        Beginning of the table and length of its records [TU past the origin, TU].
    c : (n_records, 8, 16) array
        Its coefficients [LU].
    t : float
        Epoch [TU past the origin].
    out : (16,) array
        Positions [LU], acceleration of the centre [LU/TU^2], zeros.
    """
    place = (t - start) / record
    # Outside, NaN goes through the same loop: with a second one this is not vectorized, and twice as slow.
    is_inside = 0.0 <= place <= c.shape[0]
    n = min(int(place), c.shape[0] - 1) if is_inside else 0
    x = 2.0 * (place - n) - 1.0 if is_inside else np.nan
    # T_k(x) by their recurrence; eq. (E1) of docs/method.md.
    t2 = 2.0 * x * x - 1.0
    t3 = 2.0 * x * t2 - x
    t4 = 2.0 * x * t3 - t2
    t5 = 2.0 * x * t4 - t3
    t6 = 2.0 * x * t5 - t4
    t7 = 2.0 * x * t6 - t5
    for j in range(FIELD_WIDTH):
        low = (c[n, 0, j] + x * c[n, 1, j]) + (t2 * c[n, 2, j] + t3 * c[n, 3, j])
        high = (t4 * c[n, 4, j] + t5 * c[n, 5, j]) + (t6 * c[n, 6, j] + t7 * c[n, 7, j])
        out[j] = low + high


@compiled
def gravity(gm: Array, field: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the gravitational acceleration relative to the centre, docs/method.md eq. 2.

    Parameters
    ----------
    gm : (4,) array
        Gravitational parameters of the centre and of three bodies [LU^3/TU^2].
    field : (>= 12,) array
        A row of `field_table`: positions [LU], and the acceleration of the centre [LU/TU^2].
    x, y, z : float
        Spacecraft position [LU].

    Returns
    -------
    (3,) tuple
        Acceleration [LU/TU^2].
    """
    # A root and a division cost a third of the power function.
    square = x * x + y * y + z * z
    pull = gm[0] / (square * np.sqrt(square))
    # The centre falls too, so only the difference of the two pulls is felt.
    ax, ay, az = -pull * x - field[9], -pull * y - field[10], -pull * z - field[11]
    for b in range(3):
        dx, dy, dz = field[3 * b] - x, field[3 * b + 1] - y, field[3 * b + 2] - z
        square = dx * dx + dy * dy + dz * dz
        pull = gm[b + 1] / (square * np.sqrt(square))
        ax += pull * dx
        ay += pull * dy
        az += pull * dz
    return ax, ay, az


@compiled
def fall(model: ForceModel, t: float, bodies: Array, state: Array, out: Array) -> None:
    """Write acceleration and jerk (2, 3) [LU/TU^2, LU/TU^3] of a body that gravity alone moves to out.

    Parameters
    ----------
    model : ForceModel
        Gravity.
    t : float
        Epoch [TU].
    bodies : (3, 9) array
        Positions of the three bodies, and their first and second derivatives [LU, LU/TU, LU/TU^2].
    state : (>= 6,) array
        Position and velocity [LU, LU/TU].
    out : (2, 3) array
        Written; the jerk is the time derivative of eq. 2 along the path.
    """
    field = np.empty(FIELD_WIDTH)
    field_at(model.field.start, model.field.record, model.field.coefficients, t, field)
    out[0, 0], out[0, 1], out[0, 2] = gravity(model.gm, field, state[0], state[1], state[2])
    out[1] = _pull_rate(model.gm[0], state[:3], state[3:6])
    for b in range(3):
        place, speed = bodies[0, 3 * b : 3 * b + 3], bodies[1, 3 * b : 3 * b + 3]
        out[1] += _pull_rate(model.gm[b + 1], state[:3] - place, state[3:6] - speed)
        # The centre falls too.
        out[1] += _pull_rate(model.gm[b + 1], place, speed)


@compiled
def _pull_rate(gm: float, d: Array, rate: Array) -> Array:
    """Return the time derivative of -gm d / |d|^3."""
    square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    pull = gm / (square * np.sqrt(square))
    along = (d[0] * rate[0] + d[1] * rate[1] + d[2] * rate[2]) / square
    out: Array = 3.0 * pull * along * d - pull * rate
    return out


@compiled
def gravity_gradient(
    gm: Array, field: Array, x: float, y: float, z: float
) -> tuple[float, float, float, float, float, float]:
    """Return d acceleration / d r, docs/method.md eq. 4: symmetric and without trace.

    Parameters
    ----------
    gm, field, x, y, z
        As for `gravity`.

    Returns
    -------
    (6,) tuple
        Entries xx, xy, xz, yy, yz, zz [1/TU^2].
    """
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for b in range(4):
        dx, dy, dz = x, y, z
        if b > 0:
            dx -= field[3 * b - 3]
            dy -= field[3 * b - 2]
            dz -= field[3 * b - 1]
        square = dx * dx + dy * dy + dz * dz
        # As in `gravity`, so that the compiler finds the root and the division once for both.
        pull = gm[b] / (square * np.sqrt(square))
        tide = 3.0 * pull / square
        xx += tide * dx * dx - pull
        xy += tide * dx * dy
        xz += tide * dx * dz
        yy += tide * dy * dy - pull
        yz += tide * dy * dz
        zz += tide * dz * dz - pull
    return xx, xy, xz, yy, yz, zz


@compiled
def gravity_bend(
    gm: Array, places: Array, x: float, y: float, z: float, lx: float, ly: float, lz: float
) -> tuple[float, float, float, float, float, float]:
    """Return d2 (l . acceleration) / d r2, docs/method.md eq. 28: symmetric and without trace.

    Parameters
    ----------
    gm : (4,) array
        Gravitational parameters of the centre and of three bodies [LU^3/TU^2].
    places : (>= 9,) array
        Positions of the three bodies [LU].
    x, y, z : float
        Spacecraft position [LU].
    lx, ly, lz : float
        Weights of the acceleration [-].

    Returns
    -------
    (6,) tuple
        Entries xx, xy, xz, yy, yz, zz [1/(LU TU^2)].
    """
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for b in range(4):
        dx, dy, dz = x, y, z
        if b > 0:
            dx -= places[3 * b - 3]
            dy -= places[3 * b - 2]
            dz -= places[3 * b - 1]
        inverse = 1.0 / (dx * dx + dy * dy + dz * dz)
        factor = 3.0 * gm[b] * inverse * inverse * np.sqrt(inverse)
        along = lx * dx + ly * dy + lz * dz
        tide = 5.0 * along * inverse
        xx += factor * (2.0 * lx * dx + along - tide * dx * dx)
        xy += factor * (lx * dy + ly * dx - tide * dx * dy)
        xz += factor * (lx * dz + lz * dx - tide * dx * dz)
        yy += factor * (2.0 * ly * dy + along - tide * dy * dy)
        yz += factor * (ly * dz + lz * dy - tide * dy * dz)
        zz += factor * (2.0 * lz * dz + along - tide * dz * dz)
    return xx, xy, xz, yy, yz, zz


@compiled
def gravity_rate(
    gm: Array, field: Array, moves: Array, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return the partial derivative of `gravity` by time, with the spacecraft's position fixed.

    Parameters
    ----------
    gm, field, x, y, z
        As for `gravity`.
    moves : (>= 12,) array
        Time derivative of `field` [LU/TU, LU/TU^3].

    Returns
    -------
    (3,) tuple
        Rate of the acceleration [LU/TU^3].
    """
    ax, ay, az = -moves[9], -moves[10], -moves[11]
    for b in range(3):
        dx, dy, dz = x - field[3 * b], y - field[3 * b + 1], z - field[3 * b + 2]
        ux, uy, uz = moves[3 * b], moves[3 * b + 1], moves[3 * b + 2]
        square = dx * dx + dy * dy + dz * dz
        pull = gm[b + 1] / (square * np.sqrt(square))
        tide = 3.0 * pull / square * (dx * ux + dy * uy + dz * uz)
        ax += pull * ux - tide * dx
        ay += pull * uy - tide * dy
        az += pull * uz - tide * dz
    return ax, ay, az
