"""One arc of flight by SciPy and SPICE, for the verifier alone.

Nothing here comes from `core.dynamics` or `core.transcription`: the equations of motion are written out a
second time, in other units, on another integrator, with the ephemeris read from the kernels themselves.
Frame: geocentric, J2000 axes, geometric positions.  Units: km, km/s, kg, s; time in TDB seconds past an
origin that the pilot is given, since seconds past J2000 would leave too few digits for short steps.
"""

from collections.abc import Callable
from math import cos, isfinite, sin, sqrt

import numpy as np
import scipy
import spiceypy
from numpy.typing import NDArray

# SPICE itself, called by compiled code: three times as fast as through ctypes, and the same to the last bit.
from spiceypy.cyice import spkgeo

from core.constants import GM_EARTH, GM_JUPITER, GM_MOON, GM_SUN, RADIUS_EARTH_KM, RADIUS_MOON_KM

Array = NDArray[np.float64]

EARTH = 399
MOON = 301
#: NAIF id, GM [km^3/s^2] and radius [km] of the perturbing bodies; 5 is the barycentre of Jupiter's system.
PERTURBERS = ((MOON, GM_MOON, RADIUS_MOON_KM), (10, GM_SUN, 0.0), (5, GM_JUPITER, 0.0))
#: How messages call what a trajectory may meet.
NAMES = {EARTH: "Earth", MOON: "Moon", 10: "Sun", 5: "Jupiter"}

INTEGRATOR = "scipy.integrate.DOP853"
#: Relative tolerance per step, and the least that DOP853 takes.  Between them the defects of sensitive paths
#: change by up to 0.02 km, most of it rounding, of which more steps make more.  So neither is right, and
#: where a defect is near its limit the verdict is taken at both; docs/method.md, "Verification".
RTOL, FINER_RTOL = 1e-13, 2.3e-14
#: Absolute tolerance: it rules only where a component passes through zero [km, km/s].
ATOL = np.array([1e-7, 1e-7, 1e-7, 1e-13, 1e-13, 1e-13])
#: An arc that needs more evaluations than this circles a body closely and is given up; usual are 60.
MAX_EVALUATIONS = 200_000

#: Thrust vector [kg km/s^2] and mass flow [kg/s] of a coast.
COAST = (0.0, 0.0, 0.0, 0.0)


class Unflyable(RuntimeError):
    """An arc that ends in a body, without mass, or nowhere; the message says where."""


class Pilot:
    """Flies arcs from an origin epoch and counts what that costs."""

    def __init__(
        self, origin_et: float, max_thrust_n: float, exhaust_velocity_km_s: float, rtol: float = RTOL
    ) -> None:
        self.origin_et = origin_et
        self.rtol = rtol
        self.max_thrust = max_thrust_n * 1e-3  # [kg km/s^2]
        self.exhaust_velocity = exhaust_velocity_km_s
        self.n_evaluations = 0
        #: Is shown the integrator after each of its steps.
        self.watcher: Callable[[scipy.integrate.DOP853], None] | None = None

    def thrust(self, control: Array) -> tuple[float, float, float, float]:
        """Return thrust vector [kg km/s^2] and mass flow [kg/s] of (throttle, azimuth, elevation)."""
        throttle, azimuth, elevation = (float(value) for value in control)
        force = throttle * self.max_thrust
        level, up = force * cos(elevation), force * sin(elevation)
        return level * cos(azimuth), level * sin(azimuth), up, force / self.exhaust_velocity

    def state_of(self, body: int, time: float) -> list[float]:
        """Return the geocentric state (6,) [km, km/s] of a body at a time [s].

        Seconds past J2000 are rounded to 1.2e-7 s, in which the Moon moves 1e-7 km: a noise that low
        passages amplify to 0.1 km.  SPICE answers for the rounded epoch, its velocity bridges the rest.
        """
        et = self.origin_et + time
        rest = time - (et - self.origin_et)
        x, y, z, vx, vy, vz = spkgeo(body, et, "J2000", EARTH)[0].tolist()
        return [x + rest * vx, y + rest * vy, z + rest * vz, vx, vy, vz]

    def target_state(self, naif_id: int, time: float) -> Array:
        """Return the geocentric state (6,) [km, km/s] of the target at a time [s]."""
        try:
            return np.array(self.state_of(naif_id, time))
        except spiceypy.exceptions.SpiceyError as error:
            raise Unflyable(f"target: no ephemeris {time / 86400:.3f} days after departure") from error

    def arc(
        self, time: float, state: Array, duration: float, thrust: tuple[float, float, float, float] = COAST
    ) -> Array:
        """Return the state (7,) a signed duration [s] after `time`, under constant thrust.

        Raises
        ------
        Unflyable
            When the arc meets the Earth or the Moon, uses up the mass, or cannot be integrated.
        """
        end = state.copy()
        end[6] -= thrust[3] * duration
        if not min(state[6], end[6]) > 0:
            raise Unflyable(f"no mass left {(time + duration) / 86400:.3f} days after departure")
        if duration != 0.0:
            end[:6] = self._integrated(time, state, time + duration, thrust)
        return end

    def _integrated(self, start: float, state: Array, stop: float, thrust: tuple[float, ...]) -> Array:
        budget = self.n_evaluations + MAX_EVALUATIONS
        derivative = self._equations_of_motion(start, float(state[6]), thrust)
        solver = scipy.integrate.DOP853(derivative, start, state[:6], stop, rtol=self.rtol, atol=ATOL)
        while solver.status == "running" and self.n_evaluations < budget:
            solver.step()
            if self.watcher is not None and solver.status != "failed":
                self.watcher(solver)
        if solver.status != "finished":
            raise Unflyable(f"integration gave up {solver.t / 86400:.3f} days after departure")
        return np.asarray(solver.y, dtype=np.float64)

    def _equations_of_motion(
        self, start: float, mass_at_start: float, thrust: tuple[float, ...]
    ) -> Callable[[float, Array], list[float]]:
        """Return d(position, velocity)/dt, eqs 1 and 2, with the mass of eq. 3 in closed form."""
        thrust_x, thrust_y, thrust_z, mass_flow = thrust

        # Python floats, not arrays: for three numbers numpy's overhead is ten times the arithmetic.
        def derivative(time: float, y: Array) -> list[float]:
            self.n_evaluations += 1
            x, y_, z, vx, vy, vz = y.tolist()
            distance = sqrt(x * x + y_ * y_ + z * z)
            _stay_above(RADIUS_EARTH_KM, distance, EARTH, time)
            pull = -GM_EARTH / distance**3
            mass = mass_at_start - mass_flow * (time - start)
            ax = pull * x + thrust_x / mass
            ay = pull * y_ + thrust_y / mass
            az = pull * z + thrust_z / mass
            for body, gm, radius in PERTURBERS:
                bx, by, bz, *_ = self.state_of(body, time)
                dx, dy, dz = x - bx, y_ - by, z - bz
                distance = sqrt(dx * dx + dy * dy + dz * dz)
                _stay_above(radius, distance, body, time)
                direct = gm / distance**3
                indirect = gm / sqrt(bx * bx + by * by + bz * bz) ** 3
                ax -= direct * dx + indirect * bx
                ay -= direct * dy + indirect * by
                az -= direct * dz + indirect * bz
            return [vx, vy, vz, ax, ay, az]

        return derivative


def _stay_above(radius: float, distance: float, body: int, time: float) -> None:
    # Written so that a distance that is not a number fails too.
    if not (distance > radius and isfinite(distance)):
        raise Unflyable(f"meets the {NAMES[body]} {time / 86400:.3f} days after departure")
