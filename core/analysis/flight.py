"""A solution sampled for figures: position, mass and thrust, arc by arc.

Samples are dense where an arc curves and sparse where it does not.
Frames: inertial is J2000, its origin the centre of the world.  Rotating has the same origin, x along the
first body of the world (near the Earth the Moon, with no body the target), z along its angular momentum, both
instantaneous, with lengths scaled so that the body stays at one length unit (near the Earth 384,400 km).
Units: km, kg, rad, days past the departure epoch; canonical inside.  For verification use
`core.verification.verify`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.dynamics import ForceModel, propagate
from core.ephemeris import EphemerisTable, positions, span_days, state_at
from core.jit import compiled
from core.problem import Outage, Problem
from core.transcription import TrajectoryLayout, Transcription, checked_vector, transcribe
from core.transcription.control import thrust_of
from core.units import LU_KM, TU_DAYS
from core.world import BODIES, World

Array = NDArray[np.float64]

#: Most samples of one arc, its start included.
MAX_SAMPLES = 4000
# In a quarter of a day the rotating frame turns by three degrees.
_MAX_STEP = 0.25 / TU_DAYS
#: Default relative tolerance of the steps: the error, about 0.04 km, is far below a
#: pixel of any picture.
TOLERANCE = 1e-9


@compiled
def sample_arc(
    model: ForceModel,
    t_a: float,
    t_b: float,
    control: Array,
    per_radian: float,
    tolerance: float,
    times: Array,
    states: Array,
) -> int:
    """Propagate one arc and write samples of it; the first is given.

    Parameters
    ----------
    model : ForceModel
        Forces; its table must cover the arc.
    t_a, t_b : float
        Start and end [TU], in either order.
    control : (3,) array
        Throttle [-], in-plane and out-of-plane angle [rad].
    per_radian : float
        Samples per radian of a circular orbit about the nearer body [1/rad].
    tolerance : float
        Relative tolerance of a step [-].
    times : (MAX_SAMPLES,) array
        Epochs of the samples [TU].
    states : (MAX_SAMPLES, 7) array
        Position [LU], velocity [LU/TU], mass [MU]; row 0 is the state at t_a.

    Returns
    -------
    int
        Number of samples; those after a failure are NaN.
    """
    thrust, d_thrust, d_rate = np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    ends, work = np.zeros((2, 3)), np.zeros((16, 3, 1))
    r, v = np.zeros((3, 1)), np.zeros((3, 1))
    bodies = np.empty(model.bodies.coefficients.shape[2])
    thrust_of(control, model.max_thrust, thrust, d_thrust)
    mass_rate = control[0] * model.max_thrust / model.exhaust_velocity
    times[0] = t_a
    n = 1
    while times[n - 1] != t_b and n < MAX_SAMPLES:
        t, state = times[n - 1], states[n - 1]
        positions(model.bodies, t, bodies)
        step = min(_free_fall(model.gm, bodies, state) / per_radian, _MAX_STEP)
        # The last sample allowed ends the arc; a step that nearly reaches the end does too.
        if not step < 0.999 * abs(t_b - t) or n == MAX_SAMPLES - 1:
            times[n] = t_b
        else:
            times[n] = t + step if t_b > t_a else t - step
        for i in range(3):
            r[i, 0], v[i, 0] = state[i], state[3 + i]
        taken = propagate(
            model, t, times[n], state[6], thrust, mass_rate, d_thrust, d_rate, tolerance, r, v, ends, work
        )
        for i in range(3):
            states[n, i] = r[i, 0] if taken >= 0 else np.nan
            states[n, 3 + i] = v[i, 0] if taken >= 0 else np.nan
        states[n, 6] = state[6] - mass_rate * (times[n] - t)
        n += 1
    return n


@compiled
def _free_fall(gm: Array, bodies: Array, state: Array) -> float:
    """Return the time per radian of a circular orbit about centre or first body, whichever is shorter."""
    to_center = (state[0] ** 2 + state[1] ** 2 + state[2] ** 2) ** 1.5 / gm[0]
    x, y, z = state[0] - bodies[0], state[1] - bodies[1], state[2] - bodies[2]
    to_first = (x * x + y * y + z * z) ** 1.5
    if gm[1] > 0.0:
        to_center = min(to_center, to_first / gm[1])
    return float(to_center**0.5)


#: Samples per radian of the local circular orbit: about 125 a revolution, whatever its size.
SAMPLES_PER_RADIAN = 20.0
#: Length of the target's path from the reference's insertion on [days]: one revolution of the NRHO.
TARGET_DAYS = 6.6
#: Steps along the paths of the Moon and of the target [days].
MOON_STEP_DAYS = 0.5
TARGET_STEP_DAYS = 0.01

_COAST = np.zeros(3)


class Arc(NamedTuple):
    """One arc as a range of samples; neighbouring arcs repeat the sample between them."""

    #: "coast", "thrust" or "outage".
    kind: str
    #: Segment from 1; 0 on coasts and outages.
    segment: int
    #: First sample, and one past the last.
    first: int
    stop: int
    #: Throttle [-] and angles [rad]; zero on coasts and outages.
    throttle: float
    in_plane_rad: float
    out_of_plane_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class FlownTrajectory:
    """The reference, or one realization from its outage on; time is the first index."""

    #: The outage that it recovers from; None for the reference.
    outage: Outage | None
    arcs: tuple[Arc, ...]
    #: Sample at which the backward half begins: the jump before it is the defect.
    matchpoint: int
    #: (n,) epochs [days past departure].
    days: Array
    #: (n, 3) positions [km] in both frames, and the Moon's in the inertial one.
    inertial_km: Array
    rotating_km: Array
    moon_km: Array
    #: (n, 3) velocities relative to the Earth [km/s], inertial.
    velocity_km_s: Array
    #: (n,) distances from the centres of Earth and Moon [km].
    earth_distance_km: Array
    moon_distance_km: Array
    #: (n,) speed relative to the Earth [km/s], and mass [kg].
    speed_km_s: Array
    mass_kg: Array


class Path(NamedTuple):
    """The path of a body."""

    #: (n,) epochs [days past departure].
    days: Array
    #: (n, 3) positions [km].
    inertial_km: Array
    rotating_km: Array
    #: (n, 3) position of the Moon at the same epochs, inertial [km].
    moon_km: Array


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """A solution in samples: trajectory 0 is the reference, then the realizations in order of outage."""

    trajectories: tuple[FlownTrajectory, ...]
    #: The Moon from departure to the last arrival.
    moon: Path
    #: The target orbit from the reference's insertion on.
    target: Path
    world: World
    #: The name of what the frames are about, and `moon` is: the Moon, or the target where it is far.
    main: str


class _Piece(NamedTuple):
    """A propagated arc: samples in order of time."""

    kind: str
    segment: int
    control: Array  # (3,)
    times: Array  # (n,) [TU past departure]
    states: Array  # (n, 7) canonical


class _Halves(NamedTuple):
    """A trajectory in pieces, each half in order of time."""

    forward: list[_Piece]
    backward: list[_Piece]


def fly(
    problem: Problem, x: Array, samples_per_radian: float = SAMPLES_PER_RADIAN, tolerance: float = TOLERANCE
) -> Flight:
    """Sample the reference and every realization.

    Parameters
    ----------
    problem : Problem
        P_k.
    x : (n_variables,) array
        Decision vector [days, rad, kg].
    samples_per_radian : float
        Density of the samples [1/rad], by the angular speed of a circular orbit at the place.
    tolerance : float
        Relative tolerance of the integrator [-].

    Returns
    -------
    Flight
        Trajectories, and the paths of the Moon and of the target; not finite past a passage through a body.

    Raises
    ------
    ValueError
        When x has another shape or is not finite.

    References
    ----------
    docs/method.md, "Rotating frame of the pictures".
    """
    transcription = transcribe(problem, n_legs=1)
    x = checked_vector(transcription.layout, x)
    sampler = _Sampler(transcription, samples_per_radian, tolerance)
    layout, *others = transcription.layout.trajectories
    reference = sampler.halves(layout, x, 0.0, transcription.setting.departure)
    flown = [sampler.trajectory(None, reference)]
    for layout in others:
        start, state = _start_of(layout, reference)
        flown.append(sampler.trajectory(layout.outage, sampler.halves(layout, x, start, state)))
    insertion = float(reference.backward[-1].times[0]) * sampler.units.tu_days
    arrival = max(float(trajectory.days[-1]) for trajectory in flown)
    return Flight(
        trajectories=tuple(flown),
        moon=sampler.path(sampler.moon_at, 0.0, arrival, MOON_STEP_DAYS * sampler.slowness),
        target=sampler.target_path(insertion, arrival),
        world=transcription.world,
        main=_main_of(problem, transcription.world),
    )


def _main_of(problem: Problem, world: World) -> str:
    """Return the name of the Moon, or of the target where it is far."""
    if world.moon:
        return world.moon.title
    number = getattr(problem.target, "naif_id", None)
    return next((body.title for body in BODIES.values() if body.naif_id == number), "target")


def to_rotating(position: Array, moon: Array, moon_velocity: Array, length_km: float = LU_KM) -> Array:
    """Return geocentric positions in the rotating frame of the pictures.

    Parameters
    ----------
    position, moon : (n, 3) arrays
        Positions of a point and of the Moon [km], geocentric J2000.
    moon_velocity : (n, 3) array
        Velocity of the Moon in any unit: only its direction counts [km/s].
    length_km : float
        Where on the x axis the Moon is to be [km].

    Returns
    -------
    (n, 3) array
        Scaled positions [km]; the Moon is at (length_km, 0, 0).
    """
    distance = np.linalg.norm(moon, axis=1, keepdims=True)
    momentum = np.cross(moon, moon_velocity)
    x = moon / distance
    z = momentum / np.linalg.norm(momentum, axis=1, keepdims=True)
    axes = np.stack([x, np.cross(z, x), z], axis=1)
    rotated: Array = np.einsum("nij,nj->ni", axes, position) * (length_km / distance)
    return rotated


def _start_of(layout: TrajectoryLayout, reference: _Halves) -> tuple[float, Array]:
    """Return epoch [TU] and state of the reference where the outage of a realization begins."""
    segment = layout.outage.segment if layout.outage else 1
    # Piece i ends where segment i + 1 starts: piece 0 is the initial coast.
    if segment <= len(reference.forward):
        piece = reference.forward[segment - 1]
        return float(piece.times[-1]), piece.states[-1]
    piece = reference.backward[segment - len(reference.forward)]
    return float(piece.times[0]), piece.states[0]


class _Sampler:
    """Propagates the arcs of one problem and evaluates the positions of the bodies."""

    def __init__(self, transcription: Transcription, samples_per_radian: float, tolerance: float) -> None:
        self.model, self.units = transcription.setting.model, transcription.world.units
        self.target: EphemerisTable = transcription.setting.target
        self.has_moon = transcription.world.moon is not None
        #: How many times slower things move than between Earth and Moon.
        self.slowness = self.units.tu_days / TU_DAYS
        self.density_and_tolerance = samples_per_radian, tolerance
        self._times, self._states = np.empty(MAX_SAMPLES), np.empty((MAX_SAMPLES, 7))

    def halves(self, layout: TrajectoryLayout, x: Array, start: float, state: Array) -> _Halves:
        """Return a trajectory that leaves `state` at `start` [TU], or an outage that begins there."""
        shooting, initial, final = x[layout.offset : layout.offset + 3] / self.units.tu_days
        controls = x[layout.controls].reshape(-1, 3)
        h, n_forward = shooting / layout.n_segments, layout.matchpoint - 1
        forward = []
        if layout.outage is not None:
            missed = layout.outage.duration_days / self.units.tu_days
            forward.append(self._piece("outage", 0, _COAST, start, start + missed, state))
            start, state = start + missed, forward[-1].states[-1]
        forward.append(self._piece("coast", 0, _COAST, start, start + initial, state))
        begin = start + initial
        for p in range(n_forward):
            state = forward[-1].states[-1]
            forward.append(self._thrust(p + 1, controls[p], begin + p * h, begin + (p + 1) * h, state))
        end = begin + shooting
        arrived = np.append(self._target_state(end + final), x[layout.final_mass] / self.units.mu_kg)
        backward = [self._piece("coast", 0, _COAST, end + final, end, arrived)]
        for p in range(layout.n_segments, n_forward, -1):
            state = backward[0].states[0]
            backward.insert(0, self._thrust(p, controls[p - 1], begin + p * h, begin + (p - 1) * h, state))
        return _Halves(forward, backward)

    def _thrust(self, segment: int, control: Array, t_a: float, t_b: float, state: Array) -> _Piece:
        return self._piece("thrust", segment, control, t_a, t_b, state)

    def _piece(self, kind: str, segment: int, control: Array, t_a: float, t_b: float, state: Array) -> _Piece:
        self._states[0] = state
        fineness = self.density_and_tolerance
        n = sample_arc(self.model, t_a, t_b, control, *fineness, self._times, self._states)
        order = slice(None, None, 1 if t_b >= t_a else -1)
        return _Piece(kind, segment, control, self._times[:n][order].copy(), self._states[:n][order].copy())

    def _target_state(self, t: float) -> Array:
        days = t * self.units.tu_days
        relative, moon = state_at(self.target, days), state_at(self.model.bodies, days)
        return np.concatenate([moon[0, :3] + relative[0, :3], moon[1, :3] + relative[1, :3]])

    def trajectory(self, outage: Outage | None, halves: _Halves) -> FlownTrajectory:
        """Return the samples of a trajectory in public units."""
        pieces = [*halves.forward, *halves.backward]
        stops = np.cumsum([len(piece.times) for piece in pieces])
        arcs = tuple(
            Arc(p.kind, p.segment, int(stop) - len(p.times), int(stop), *(float(u) for u in p.control))
            for p, stop in zip(pieces, stops, strict=True)
        )
        days = np.concatenate([piece.times for piece in pieces]) * self.units.tu_days
        states = np.concatenate([piece.states for piece in pieces]) * self.units.state
        position = states[:, :3]
        moon, moon_velocity = self.moon_states(days)
        return FlownTrajectory(
            outage=outage,
            arcs=arcs,
            matchpoint=arcs[len(halves.forward)].first,
            days=days,
            inertial_km=position,
            rotating_km=to_rotating(position, moon, moon_velocity, self.units.lu_km),
            moon_km=moon,
            velocity_km_s=states[:, 3:6],
            earth_distance_km=np.asarray(np.linalg.norm(position, axis=1)),
            moon_distance_km=np.asarray(np.linalg.norm(position - moon, axis=1)),
            speed_km_s=np.asarray(np.linalg.norm(states[:, 3:6], axis=1)),
            mass_kg=states[:, 6],
        )

    def moon_states(self, days: Array) -> tuple[Array, Array]:
        """Return positions [km] and velocities [km/s] of the Moon, (n, 3) each."""
        states = np.array([self._main(moment) for moment in days])
        return states[:, 0] * self.units.lu_km, states[:, 1] * self.units.vu_km_s

    def _main(self, days: float) -> Array:
        """Return position and velocity (2, 3) of the Moon, or of the target where it is far."""
        first: Array = state_at(self.model.bodies, days)[:2, :3]
        return first if self.has_moon else first + state_at(self.target, days)[:2, :3]

    def moon_at(self, days: float) -> Array:
        """Return the position of the Moon, or of the target where it is far (3,) [LU]."""
        position: Array = self._main(days)[0]
        return position

    def target_at(self, days: float) -> Array:
        """Return the position of the target (3,) [LU]."""
        return state_at(self.model.bodies, days)[0, :3] + state_at(self.target, days)[0, :3]

    def target_path(self, insertion: float, arrival: float) -> Path:
        """Return the path of the target: a revolution from insertion on, about the Sun all of the flight."""
        if self.slowness > 1.0:
            return self.path(self.target_at, 0.0, arrival, MOON_STEP_DAYS * self.slowness)
        return self.path(self.target_at, insertion, insertion + TARGET_DAYS, TARGET_STEP_DAYS)

    def path(self, place: Callable[[float], Array], start: float, stop: float, step: float) -> Path:
        """Return the path of a body between two epochs [days], as far as the tables reach."""
        stop = min(stop, span_days(self.target)[1], span_days(self.model.bodies)[1])
        days = np.linspace(start, stop, max(2, round((stop - start) / step) + 1))
        position = np.array([place(moment) for moment in days]) * self.units.lu_km
        moon, moon_velocity = self.moon_states(days)
        return Path(days, position, to_rotating(position, moon, moon_velocity, self.units.lu_km), moon)
