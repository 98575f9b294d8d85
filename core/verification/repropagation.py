"""Independent propagation of a solution by SciPy and SPICE, in halves: forward, and backward from the target.

Nothing here comes from `core.dynamics` or `core.transcription`: the layout of x, the segments, the outages
and the equations of motion are written out a second time on purpose, in other units, on another integrator,
with the ephemeris read from the kernels themselves.
Frame: origin at the centre of the world, J2000 axes, geometric positions.  Units: km, km/s, kg, s; times in
seconds past the departure epoch, since seconds past J2000 would leave too few digits for short steps.
"""

from collections.abc import Callable, Sequence
from math import cos, isfinite, sin, sqrt
from typing import NamedTuple

import numpy as np
import scipy
import spiceypy
from numpy.typing import NDArray

# SPICE itself, called by compiled code: three times as fast as through ctypes, and the same to the last bit.
from spiceypy.cyice import spkgeo

from core.constants import G0, SECONDS_PER_DAY
from core.orbits import departure_state
from core.problem import Problem
from core.world import EARTH, Body, World, world_of

Array = NDArray[np.float64]

INTEGRATOR = "scipy.integrate.DOP853"
#: Relative tolerance per step, and the least that DOP853 takes.  Between them the defects of sensitive paths
#: change by up to 0.02 km, mostly by rounding, which grows with the number of steps.  So neither is exact,
#: and where a defect is near its limit, it has to be within it at both; docs/method.md, "Verification".
RTOL, FINER_RTOL = 1e-13, 2.3e-14
#: Absolute tolerance: it matters only where a component passes through zero [km, km/s].
ATOL = np.array([1e-7, 1e-7, 1e-7, 1e-13, 1e-13, 1e-13])
#: Limit of evaluations per arc, exceeded only in close orbits about a body; usual are 60.
MAX_EVALUATIONS = 200_000

#: Thrust vector [kg km/s^2] and mass flow [kg/s] of a coast.
COAST = (0.0, 0.0, 0.0, 0.0)


class UnflyableError(RuntimeError):
    """An arc that cannot be propagated: it meets a body, runs out of mass, or takes too many steps."""


class Pilot:
    """Propagates arcs, with times from an origin epoch, and counts evaluations."""

    def __init__(
        self,
        origin_et: float,
        max_thrust_n: float,
        exhaust_velocity_km_s: float,
        rtol: float = RTOL,
        world: World = EARTH,
    ) -> None:
        self.origin_et = origin_et
        #: The centre, and what pulls besides.
        self.center, self.bodies = world.center, world.bodies
        self.rtol = rtol
        self.max_thrust = max_thrust_n * 1e-3  # [kg km/s^2]
        self.exhaust_velocity = exhaust_velocity_km_s
        self.n_evaluations = 0
        #: Called with the integrator after each of its steps.
        self.watcher: Callable[[scipy.integrate.DOP853], None] | None = None

    def thrust(self, control: Array) -> tuple[float, float, float, float]:
        """Return thrust vector [kg km/s^2] and mass flow [kg/s] of (throttle, azimuth, elevation)."""
        throttle, azimuth, elevation = (float(value) for value in control)
        force = throttle * self.max_thrust
        level, up = force * cos(elevation), force * sin(elevation)
        return level * cos(azimuth), level * sin(azimuth), up, force / self.exhaust_velocity

    def state_of(self, body: int, time: float) -> list[float]:
        """Return the state (6,) [km, km/s] of a body relative to the centre at a time [s].

        Seconds past J2000 are rounded to 1.2e-7 s, in which the Moon moves 1e-7 km: a noise that low
        passages amplify to 0.1 km.  SPICE answers for the rounded epoch, its velocity bridges the rest.
        """
        et = self.origin_et + time
        rest = time - (et - self.origin_et)
        x, y, z, vx, vy, vz = spkgeo(body, et, "J2000", self.center.naif_id)[0].tolist()
        return [x + rest * vx, y + rest * vy, z + rest * vz, vx, vy, vz]

    def target_state(self, naif_id: int, time: float) -> Array:
        """Return the state (6,) [km, km/s] of the target relative to the centre at a time [s]."""
        try:
            return np.array(self.state_of(naif_id, time))
        except spiceypy.exceptions.SpiceyError as error:
            raise UnflyableError(f"target: no ephemeris {time / 86400:.3f} days after departure") from error

    def arc(
        self, time: float, state: Array, duration: float, thrust: tuple[float, float, float, float] = COAST
    ) -> Array:
        """Return the state (7,) a signed duration [s] after `time`, under constant thrust.

        Raises
        ------
        UnflyableError
            When the arc meets a body, uses up the mass, or cannot be integrated.
        """
        end = state.copy()
        end[6] -= thrust[3] * duration
        if not min(state[6], end[6]) > 0:
            raise UnflyableError(f"no mass left {(time + duration) / 86400:.3f} days after departure")
        if duration != 0.0:
            end[:6] = self._integrate(time, state, time + duration, thrust)
        return end

    def _integrate(self, start: float, state: Array, stop: float, thrust: tuple[float, ...]) -> Array:
        budget = self.n_evaluations + MAX_EVALUATIONS
        derivative = self._equations_of_motion(start, float(state[6]), thrust)
        solver = scipy.integrate.DOP853(derivative, start, state[:6], stop, rtol=self.rtol, atol=ATOL)
        while solver.status == "running" and self.n_evaluations < budget:
            solver.step()
            if self.watcher is not None and solver.status != "failed":
                self.watcher(solver)
        if solver.status != "finished":
            raise UnflyableError(f"integration gave up {solver.t / 86400:.3f} days after departure")
        return np.asarray(solver.y, dtype=np.float64)

    def _equations_of_motion(
        self, start: float, mass_at_start: float, thrust: tuple[float, ...]
    ) -> Callable[[float, Array], list[float]]:
        """Return d(position, velocity)/dt, eqs 1 and 2, with the mass of eq. 3 in closed form."""
        thrust_x, thrust_y, thrust_z, mass_flow = thrust

        center = self.center

        # Python floats, not arrays: for three numbers numpy's overhead is ten times the arithmetic.
        def derivative(time: float, y: Array) -> list[float]:
            self.n_evaluations += 1
            x, y_, z, vx, vy, vz = y.tolist()
            distance = sqrt(x * x + y_ * y_ + z * z)
            _stay_above(center, distance, time)
            pull = -center.gm_km3_s2 / distance**3
            mass = mass_at_start - mass_flow * (time - start)
            ax = pull * x + thrust_x / mass
            ay = pull * y_ + thrust_y / mass
            az = pull * z + thrust_z / mass
            for body in self.bodies:
                gm = body.gm_km3_s2
                bx, by, bz, *_ = self.state_of(body.naif_id, time)
                dx, dy, dz = x - bx, y_ - by, z - bz
                distance = sqrt(dx * dx + dy * dy + dz * dz)
                _stay_above(body, distance, time)
                direct = gm / distance**3
                indirect = gm / sqrt(bx * bx + by * by + bz * bz) ** 3
                ax -= direct * dx + indirect * bx
                ay -= direct * dy + indirect * by
                az -= direct * dz + indirect * bz
            return [vx, vy, vz, ax, ay, az]

        return derivative


def _stay_above(body: Body, distance: float, time: float) -> None:
    # Written so that a distance that is not a number fails too.
    if not (distance > body.radius_km and isfinite(distance)):
        raise UnflyableError(f"meets the {body.title} {time / 86400:.3f} days after departure")


class Plan(NamedTuple):
    """The part of x that belongs to one trajectory; times in seconds."""

    shooting: float
    initial_coast: float
    final_coast: float
    controls: Array  # (n_segments, 3)
    final_mass: float

    @property
    def n_forward(self) -> int:
        """Number of segments propagated forward."""
        return len(self.controls) // 2

    @property
    def segment_duration(self) -> float:
        """Length of a segment [s]."""
        return self.shooting / len(self.controls)


class HalfTrajectories(NamedTuple):
    """States at the starts of the segments; times in seconds past the departure epoch."""

    #: y_1 .. y_{Nf+1}, (n_forward + 1, 7).
    forward: Array
    #: z_{Nf+1} .. z_{N+1}, (n_backward + 1, 7).
    backward: Array
    #: Start of the first segment, and arrival.
    start: float
    arrival: float
    target_error: tuple[float, float]
    failure: str


def _segment_counts(problem: Problem) -> list[int]:
    n = problem.n_segments
    adaptive = problem.segmentation == "adaptive"
    return [n, *(n - outage.segment if adaptive else n for outage in problem.outages)]


def plans_of(problem: Problem, x: Array) -> list[Plan]:
    """Return the reference and the realizations of x, or raise ValueError saying why x is no such vector."""
    counts = _segment_counts(problem)
    expected = sum(3 * count + 4 for count in counts)
    x = np.asarray(x, dtype=np.float64)
    if x.shape != (expected,):
        case = f"{problem.n_segments} segments and {problem.k} outages"
        raise ValueError(f"decision vector: expected shape ({expected},) for {case}, got {x.shape}")
    if not np.all(np.isfinite(x)):
        first = int(np.flatnonzero(~np.isfinite(x))[0])
        raise ValueError(f"decision vector: expected finite numbers, got {x[first]} at index {first}")
    plans = []
    for count in counts:
        own, x = np.split(x, [3 * count + 4])
        times = own[:3] * SECONDS_PER_DAY
        controls = own[3:-1].reshape(count, 3)
        plans.append(Plan(float(times[0]), float(times[1]), float(times[2]), controls, float(own[-1])))
    return plans


def departure_of(problem: Problem) -> tuple[float, Array]:
    """Return the departure epoch [TDB s past J2000] and state (7,) [km, km/s, kg]."""
    start = departure_state(problem.departure, problem.spacecraft)
    return start.et, np.array([*start.position_km, *start.velocity_km_s, start.mass_kg])


def pilot_of(problem: Problem, rtol: float = RTOL) -> Pilot:
    """Return the propagator of a problem's arcs."""
    craft = problem.spacecraft
    return Pilot(
        departure_of(problem)[0], craft.max_thrust_n, craft.isp_s * G0 * 1e-3, rtol, world_of(problem)
    )


def fly_all(
    pilot: Pilot,
    problem: Problem,
    plans: list[Plan],
    naif_id: int,
    watchers: Sequence[Callable[["scipy.integrate.DOP853"], None] | None],
) -> list[HalfTrajectories]:
    """Propagate every trajectory in halves; a watcher is called after each step of its trajectory."""
    pilot.watcher, *others = watchers
    _, state = departure_of(problem)
    reference = _fly(pilot, plans[0], 0.0, state, plans[0].initial_coast, naif_id)
    flights = [reference]
    for outage, plan, pilot.watcher in zip(problem.outages, plans[1:], others, strict=True):
        start = reference.start + (outage.segment - 1) * plans[0].segment_duration
        coast = outage.duration_days * SECONDS_PER_DAY + plan.initial_coast
        source = _reference_state_at(plans[0], reference, outage.segment)
        flights.append(_fly(pilot, plan, start, source, coast, naif_id))
    return flights


def _reference_state_at(plan: Plan, reference: HalfTrajectories, segment: int) -> Array:
    """Return the state of the reference at the start of a segment, from the half that contains it."""
    matchpoint = plan.n_forward + 1
    is_forward = segment <= matchpoint
    state: Array = reference.forward[segment - 1] if is_forward else reference.backward[segment - matchpoint]
    return state


def _fly(
    pilot: Pilot, plan: Plan, departure: float, state: Array, coast: float, naif_id: int
) -> HalfTrajectories:
    start = departure + coast
    end = start + plan.shooting
    arrival = end + plan.final_coast
    n_forward, h = plan.n_forward, plan.segment_duration
    forward = np.full((n_forward + 1, 7), np.nan)
    backward = np.full((len(plan.controls) - n_forward + 1, 7), np.nan)
    target_error = (np.nan, np.nan)
    failure = "" if np.all(np.isfinite(state)) else "starts from a reference that could not be flown"
    try:
        if not failure:
            forward[0] = pilot.arc(departure, state, coast)
            for p, control in enumerate(plan.controls[:n_forward]):
                forward[p + 1] = pilot.arc(start + p * h, forward[p], h, pilot.thrust(control))
    except UnflyableError as reason:
        failure = str(reason)
    try:
        at_target = np.append(pilot.target_state(naif_id, arrival), plan.final_mass)
        backward[-1] = pilot.arc(arrival, at_target, -plan.final_coast)
        target_error = distance(backward[-1], pilot.target_state(naif_id, end))
        for p in range(len(plan.controls), n_forward, -1):
            i = p - n_forward
            backward[i - 1] = pilot.arc(start + p * h, backward[i], -h, pilot.thrust(plan.controls[p - 1]))
    except UnflyableError as reason:
        failure = failure or str(reason)
    return HalfTrajectories(forward, backward, start, arrival, target_error, failure)


def distance(state: Array, other: Array) -> tuple[float, float]:
    """Return the differences of two states in position and in velocity, as norms."""
    difference = state[:6] - other
    return float(np.linalg.norm(difference[:3])), float(np.linalg.norm(difference[3:]))
