"""Piecewise Chebyshev polynomials of body positions, with exact first and second derivatives.

Frame: J2000 axes; `body_table` is relative to the centre of a world, its columns are x, y, z of each body.
Units: LU, TU past an origin epoch; epochs of the Python functions are days past that origin.

    EpochError(ValueError)   an epoch outside a table or a kernel
"""

import math
from functools import partial
from typing import NamedTuple

import numpy as np
import spiceypy
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from core.constants import KERNEL_SPAN, SECONDS_PER_DAY
from core.ephemeris.kernels import furnish, loaded, one_at_a_time
from core.epochs import calendar_epoch
from core.jit import compiled
from core.units import TU_DAYS
from core.world import EARTH, MOST_BODIES, World

Array = NDArray[np.float64]

#: Coefficients of a record that `positions` takes for granted.
MIN_COEFFICIENTS = 8

#: Records of `body_table` [days] and their coefficients: degree 7 over a day leaves 0.2 mm for the Moon, over
#: half a day less than rounding does.
BODY_RECORD_DAYS, FINE_RECORD_DAYS = 1.0, 0.5
BODY_COEFFICIENTS = MIN_COEFFICIENTS
#: How many times longer records are about the Sun, where no body of ours is quicker than Mercury.
SLOWER_ABOUT_SUN = 4


class EpochError(ValueError):
    """An epoch outside the span of a table or of a kernel."""


class EphemerisTable(NamedTuple):
    """Polynomials in x in [-1, 1] over records of one length, with `MIN_COEFFICIENTS` each or more."""

    #: Beginning of the first record [TU past the origin].
    start: float
    #: Length of a record [TU].
    record: float
    #: (n_records, n_coefficients, n_columns) Chebyshev coefficients [LU].
    coefficients: Array
    #: Whether it is a path of the force model, which then knows its acceleration better than the polynomials.
    is_ballistic: bool = False
    #: The unit of time [days].
    tu_days: float = TU_DAYS


@one_at_a_time
def body_table(
    origin_et: float, start_days: float, stop_days: float, is_fine: bool = False, world: World = EARTH
) -> EphemerisTable:
    """Return the positions of a world's bodies as DE440 has them, relative to its centre.

    Parameters
    ----------
    origin_et : float
        Epoch from which the table counts time [TDB s past J2000].
    start_days, stop_days : float
        Span [days past the origin]; the last record may reach further, but not where the world has a kernel.
    is_fine : bool
        Whether trajectories are flown by it, whose Moon may be off by micrometres only: low passages
        magnify the rest. Departures and orbits of the target keep the coarse table by which they are known.
    world : World
        Its centre, its bodies and its units.

    Returns
    -------
    EphemerisTable
        Nine columns: three for each body [LU], zeros where there are fewer than three.

    Raises
    ------
    EpochError
        When the span is empty or leaves DE440.
    """
    furnish()
    if not (math.isfinite(stop_days - start_days) and start_days < stop_days):
        raise EpochError(
            f"span: expected start < stop, got {start_days} and {stop_days} days past the origin"
        )
    record_days = fine_record_days(world) * (1.0 if is_fine else BODY_RECORD_DAYS / FINE_RECORD_DAYS)
    n_records = math.ceil((stop_days - start_days) / record_days)
    if world.kernel is not None:
        # Nothing may be known beyond the span.
        record_days = (stop_days - start_days) / n_records
    first = origin_et + start_days * SECONDS_PER_DAY
    last = first + n_records * record_days * SECONDS_PER_DAY
    if not (KERNEL_SPAN[0] <= first and last <= KERNEL_SPAN[1]):
        raise EpochError(
            f"epoch: expected {calendar_epoch(KERNEL_SPAN[0])}..{calendar_epoch(KERNEL_SPAN[1])} (DE440), "
            f"got {calendar_epoch(first)}..{calendar_epoch(last)}"
        )

    begin = start_days * SECONDS_PER_DAY if is_fine else first
    nodes = record_nodes(begin, record_days * SECONDS_PER_DAY, n_records, BODY_COEFFICIENTS)
    position = partial(_precise_positions, world, origin_et) if is_fine else partial(_positions, world)
    samples = np.zeros((*nodes.shape, 3 * MOST_BODIES))
    if world.bodies:
        # By rounding the last node may be past the end, of which a kernel need know nothing.
        latest = nodes[-1, -1] if world.kernel is None else begin + (stop_days - start_days) * SECONDS_PER_DAY
        with loaded(world.kernel):
            found = np.array([[position(min(time, latest)) for time in record] for record in nodes])
        samples[:, :, : found.shape[2]] = found
    units = world.units
    coefficients = coefficients_through(samples / units.lu_km)
    start, record = start_days / units.tu_days, record_days / units.tu_days
    return EphemerisTable(start, record, coefficients, tu_days=units.tu_days)


def fine_record_days(world: World) -> float:
    """Return the length of the records by which trajectories are flown in a world [days]."""
    return FINE_RECORD_DAYS * (SLOWER_ABOUT_SUN if world.center.name == "SUN" else 1)


def _positions(world: World, et: float) -> Array:
    center = world.center.name
    return np.concatenate([spiceypy.spkpos(b.name, et, "J2000", "NONE", center)[0] for b in world.bodies])


def _precise_positions(world: World, origin_et: float, seconds: float) -> Array:
    """Return positions (9,) [km] some seconds past an origin, free of the grid of seconds past J2000.

    On it the Moon is off by up to 6e-8 km; derivatives of the polynomials make 1e-10 km/s of that, and low
    passages 0.1 km of both.
    """
    et = origin_et + seconds
    rest = seconds - (et - origin_et)
    center = world.center.name
    found = [spiceypy.spkezr(body.name, et, "J2000", "NONE", center)[0] for body in world.bodies]
    return np.concatenate([state[:3] + rest * state[3:] for state in found])


def record_nodes(start: float, record: float, n_records: int, n_coefficients: int) -> Array:
    """Return the epochs (n_records, n_coefficients) at which `coefficients_through` wants its samples.

    Parameters
    ----------
    start, record : float
        Beginning of the first record and length of each [any unit of time].
    n_records, n_coefficients : int
        Numbers of records and of coefficients in each.
    """
    return start + record * (np.arange(n_records)[:, None] + 0.5 * (_extrema(n_coefficients) + 1.0))


def coefficients_through(samples: Array) -> Array:
    """Return the Chebyshev coefficients of the polynomials through samples, both of one shape and unit.

    Parameters
    ----------
    samples : (n_records, n_coefficients, n_columns) array
        Values at `record_nodes` [any unit].
    """
    n_coefficients = samples.shape[1]
    to_coefficients = np.linalg.inv(chebyshev.chebvander(_extrema(n_coefficients), n_coefficients - 1))
    return np.ascontiguousarray(np.einsum("kj,rjc->rkc", to_coefficients, samples))


def values_at_nodes(table: EphemerisTable) -> Array:
    """Return values (n_records, n_coefficients, n_columns) of a table at `record_nodes` [as its own]."""
    n_coefficients = table.coefficients.shape[1]
    from_coefficients = chebyshev.chebvander(_extrema(n_coefficients), n_coefficients - 1)
    return np.asarray(np.einsum("jk,rkc->rjc", from_coefficients, table.coefficients))


def _extrema(n: int) -> Array:
    # They include both ends, so that neighbouring records meet and an integrator sees no jump.
    return np.asarray(-np.cos(np.pi * np.arange(n) / (n - 1)))


def span_days(table: EphemerisTable) -> tuple[float, float]:
    """Return the first and the last epoch of a table [days past its origin]."""
    length = table.record * table.coefficients.shape[0]
    return table.start * table.tu_days, (table.start + length) * table.tu_days


def state_at(table: EphemerisTable, days: float) -> Array:
    """Return value, first and second derivative (3, n_columns) [LU, LU/TU, LU/TU^2] at an epoch.

    Parameters
    ----------
    table : EphemerisTable
        Any table.
    days : float
        Epoch [days past the origin of the table].

    Raises
    ------
    EpochError
        When the epoch is outside the table.
    """
    out = np.empty((3, table.coefficients.shape[2]))
    states(table, days / table.tu_days, out)
    if np.isnan(out).any():
        start, stop = span_days(table)
        raise EpochError(f"epoch: expected {start:.6f}..{stop:.6f} days past the origin, got {days:.6f}")
    return out


@compiled
def positions(table: EphemerisTable, t: float, out: Array) -> None:
    """Write the values (n_columns,) [LU] at t [TU past the origin] to out; NaN outside the span.

    About a thousand calls make a millisecond of the solver, hence the first eight terms in one expression.
    """
    record, x = _record_at(table, t)
    if record < 0:
        out[:] = np.nan
        return
    c = table.coefficients[record]
    # T_k(x) by their recurrence; eq. (E1) of docs/method.md.
    t2 = 2.0 * x * x - 1.0
    t3 = 2.0 * x * t2 - x
    t4 = 2.0 * x * t3 - t2
    t5 = 2.0 * x * t4 - t3
    t6 = 2.0 * x * t5 - t4
    t7 = 2.0 * x * t6 - t5
    for j in range(c.shape[1]):
        low = (c[0, j] + x * c[1, j]) + (t2 * c[2, j] + t3 * c[3, j])
        out[j] = low + ((t4 * c[4, j] + t5 * c[5, j]) + (t6 * c[6, j] + t7 * c[7, j]))
    for k in range(8, c.shape[0]):
        t6, t7 = t7, 2.0 * x * t7 - t6
        for j in range(c.shape[1]):
            out[j] += t7 * c[k, j]


@compiled
def states(table: EphemerisTable, t: float, out: Array) -> None:
    """Write value, first and second time derivative (3, n_columns) at t [TU] to out; NaN outside the span.

    All three come from one polynomial, so they are consistent to rounding [LU, LU/TU, LU/TU^2].
    """
    record, x = _record_at(table, t)
    if record < 0:
        out[:] = np.nan
        return
    c = table.coefficients[record]
    rate = 2.0 / table.record
    # The recurrence of T_k and its first and second derivative in x; eq. (E2).
    below, value = 1.0, x
    d_below, d_value = 0.0, 1.0
    dd_below, dd_value = 0.0, 0.0
    for j in range(c.shape[1]):
        out[0, j] = c[0, j] + x * c[1, j]
        out[1, j] = rate * c[1, j]
        out[2, j] = 0.0
    for k in range(2, c.shape[0]):
        dd_below, dd_value = dd_value, 4.0 * d_value + 2.0 * x * dd_value - dd_below
        d_below, d_value = d_value, 2.0 * value + 2.0 * x * d_value - d_below
        below, value = value, 2.0 * x * value - below
        for j in range(c.shape[1]):
            out[0, j] += value * c[k, j]
            out[1, j] += rate * d_value * c[k, j]
            out[2, j] += rate * rate * dd_value * c[k, j]


@compiled
def jerks(table: EphemerisTable, t: float, out: Array) -> None:
    """Write the third time derivative (>= n_columns,) [LU/TU^3] at t [TU] to out; NaN outside the span."""
    record, x = _record_at(table, t)
    if record < 0:
        out[:] = np.nan
        return
    c = table.coefficients[record]
    cube = (2.0 / table.record) ** 3
    # The recurrence of T_k and its derivatives in x, as in `states`.
    below, value = 1.0, x
    d_below, d_value = 0.0, 1.0
    dd_below, dd_value = 0.0, 0.0
    ddd_below, ddd_value = 0.0, 0.0
    out[:] = 0.0
    for k in range(2, c.shape[0]):
        ddd_below, ddd_value = ddd_value, 6.0 * dd_value + 2.0 * x * ddd_value - ddd_below
        dd_below, dd_value = dd_value, 4.0 * d_value + 2.0 * x * dd_value - dd_below
        d_below, d_value = d_value, 2.0 * value + 2.0 * x * d_value - d_below
        below, value = value, 2.0 * x * value - below
        for j in range(c.shape[1]):
            out[j] += cube * ddd_value * c[k, j]


@compiled
def _record_at(table: EphemerisTable, t: float) -> tuple[int, float]:
    """Return the record that holds t and the place x in [-1, 1] inside it; -1 outside the span."""
    n_records = table.coefficients.shape[0]
    place = (t - table.start) / table.record
    if not (0.0 <= place <= n_records):
        return -1, 0.0
    record = min(int(place), n_records - 1)
    return record, 2.0 * (place - record) - 1.0
