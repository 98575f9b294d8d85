"""The state in which a transfer starts: given, or at the end of a spiral around the Earth.

A spiral thrusts fully along the geocentric velocity from the perigee of a parking orbit.
Frame: geocentric, axes J2000.  Units: km, km/s, kg, TDB s past J2000 at the surface; canonical inside,
with times in TU past the start of the spiral.

    SpiralError(RuntimeError)   a spiral that does not reach its end
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from core.constants import G0, GM_EARTH, RADIUS_EARTH_KM
from core.dynamics.force import FIELD_WIDTH, field_at, field_table, gm_of, gravity
from core.ephemeris import EphemerisTable, body_table, states
from core.epochs import calendar_epoch, seconds_past_j2000
from core.errors import UserError
from core.jit import compiled
from core.orbits.rotating import jacobi
from core.problem import Spacecraft, SpiralDeparture, StateDeparture
from core.units import (
    LU_KM,
    MU_KG,
    TU_DAYS,
    TU_S,
    VU_KM_S,
)
from core.world import EARTH

Array = NDArray[np.float64]

#: Longest spiral [days].
LONGEST_SPIRAL_DAYS = 3000.0

# Errors grow with the square of the time along the track, over some 200 revolutions: this leaves 3 m.
_TOLERANCE = 3e-14


class SpiralError(UserError, RuntimeError):
    """A spiral that hits the Earth, or runs out of propellant, before its end."""


class DepartureState(NamedTuple):
    """The state in which a transfer starts, geocentric J2000."""

    #: TDB seconds past J2000.
    et: float
    #: (3,) position [km].
    position_km: Array
    #: (3,) velocity [km/s].
    velocity_km_s: Array
    #: Mass [kg].
    mass_kg: float


@dataclass(frozen=True, slots=True)
class _Patience:
    """A stop callback that compares equal to any other, since it does not affect a finished spiral."""

    stop: Callable[[], bool] | None = field(default=None, compare=False)


def departure_state(
    departure: StateDeparture | SpiralDeparture,
    spacecraft: Spacecraft,
    stop: Callable[[], bool] | None = None,
) -> DepartureState:
    """Return the state in which a transfer starts, computing the spiral where there is one.

    Parameters
    ----------
    departure : StateDeparture or SpiralDeparture
        The departure of a problem.
    spacecraft : Spacecraft
        Mass [kg], thrust [N] and specific impulse [s] for the spiral.
    stop : callable, optional
        Asked at every step whether to give up.

    Raises
    ------
    SpiralError
        When the propellant is spent before the Jacobi value or the duration is reached, the spiral meets the
        Earth, or it was stopped.
    """
    if isinstance(departure, SpiralDeparture):
        return _end_of_spiral(departure, spacecraft, _Patience(stop))
    return DepartureState(
        seconds_past_j2000(departure.epoch),
        np.array(departure.position_km),
        np.array(departure.velocity_km_s),
        departure.mass_kg,
    )


@functools.lru_cache(maxsize=256)
def _end_of_spiral(departure: SpiralDeparture, spacecraft: Spacecraft, patience: _Patience) -> DepartureState:
    start_et = seconds_past_j2000(departure.epoch)
    max_thrust = EARTH.units.thrust(spacecraft.max_thrust_n)
    mass_rate = max_thrust / EARTH.units.exhaust_velocity(spacecraft.isp_s, G0)
    # With the dry mass the tanks are empty.
    longest = (spacecraft.wet_mass_kg - spacecraft.dry_mass_kg) / MU_KG / mass_rate
    stop = min(longest, (departure.duration_days or LONGEST_SPIRAL_DAYS) / TU_DAYS)
    bodies = body_table(start_et, 0.0, stop * TU_DAYS)
    gm = gm_of(EARTH)
    arc = scipy.integrate.solve_ivp(
        _rates,
        (0.0, stop),
        np.append(_perigee(departure), spacecraft.wet_mass_kg / MU_KG),
        method="DOP853",
        rtol=_TOLERANCE,
        atol=_TOLERANCE,
        args=(field_table(gm, bodies), gm, max_thrust, mass_rate),
        events=[_surface(departure, patience), *_until(departure, bodies)],
    )
    t, y = float(arc.t[-1]), arc.y[:, -1]
    is_fallen = arc.status == 1 and len(arc.t_events[0]) > 0
    is_at_end = arc.status == 1 if departure.jacobi is not None else stop < longest
    if is_fallen or not (arc.success and is_at_end):
        reason = "the tanks are empty" if stop == longest else f"{LONGEST_SPIRAL_DAYS:g} days are over"
        reason = "it meets the Earth" if is_fallen else reason if arc.success else arc.message
        raise SpiralError(
            f"spiral: expected {_goal(departure)} before the propellant is spent, "
            f"got an end at {calendar_epoch(start_et + t * TU_S)}: {reason}"
        )
    return DepartureState(start_et + t * TU_S, y[:3] * LU_KM, y[3:6] * VU_KM_S, float(y[6]) * MU_KG)


def _goal(departure: SpiralDeparture) -> str:
    if departure.jacobi is not None:
        return f"the Jacobi constant to fall to {departure.jacobi}"
    return f"{departure.duration_days} days of thrust"


def _perigee(departure: SpiralDeparture) -> Array:
    """Return the state (6,) [LU, LU/TU] at perigee of the parking orbit."""
    perigee, apogee = departure.perigee_radius_km, departure.apogee_radius_km
    speed = np.sqrt(GM_EARTH * 2.0 * apogee / (perigee * (perigee + apogee)))
    node, tilt, turn = np.radians(
        [departure.raan_deg, departure.inclination_deg, departure.argument_of_perigee_deg]
    )
    towards_node = np.array([np.cos(node), np.sin(node), 0.0])
    across = np.array([-np.cos(tilt) * np.sin(node), np.cos(tilt) * np.cos(node), np.sin(tilt)])
    radial = np.cos(turn) * towards_node + np.sin(turn) * across
    forward = -np.sin(turn) * towards_node + np.cos(turn) * across
    return np.concatenate([perigee / LU_KM * radial, speed / VU_KM_S * forward])


def _surface(departure: SpiralDeparture, patience: _Patience) -> Callable[..., float]:
    """Return the event of hitting the Earth, which also checks whether to stop."""

    def height(t: float, y: Array, *_: object) -> float:
        if patience.stop is not None and patience.stop():
            raise SpiralError(
                f"spiral: expected {_goal(departure)} within the time for its computation, got to "
                f"{t * TU_DAYS:.1f} days; begin higher, thrust more, or give its end as a state"
            )
        return float(np.sqrt(y[0] ** 2 + y[1] ** 2 + y[2] ** 2)) - RADIUS_EARTH_KM / LU_KM

    height.terminal, height.direction = True, -1.0  # type: ignore[attr-defined]
    return height


def _until(departure: SpiralDeparture, bodies: EphemerisTable) -> list[Callable[..., float]]:
    """Return the event at which the spiral ends, if not at a given time."""
    if departure.jacobi is None:
        return []
    goal, place = departure.jacobi, np.empty((3, bodies.coefficients.shape[2]))

    def excess(t: float, y: Array, *_: object) -> float:
        states(bodies, t, place)
        return jacobi(place[:, :3], y[:3], y[3:6]) - goal

    excess.terminal, excess.direction = True, -1.0  # type: ignore[attr-defined]
    return [excess]


@compiled
def _rates(
    t: float, y: Array, field: EphemerisTable, gm: Array, max_thrust: float, mass_rate: float
) -> Array:
    """Return the derivative of the state (7,): docs/method.md eqs. 1-3 with the thrust along the velocity."""
    here, rates = np.empty(FIELD_WIDTH), np.empty(7)
    field_at(field.start, field.record, field.coefficients, t, here)
    rates[:3] = y[3:6]
    rates[3], rates[4], rates[5] = gravity(gm, here, y[0], y[1], y[2])
    push = max_thrust / (y[6] * np.sqrt(y[3] ** 2 + y[4] ** 2 + y[5] ** 2))
    for i in range(3):
        rates[3 + i] += push * y[3 + i]
    rates[6] = -mass_rate
    return rates
