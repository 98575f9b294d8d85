"""P_k as functions of its decision vector: defects and their sparse Jacobian.

Public methods take x and return physical units (days, kg, rad; km, km/s, kg).  The lifted forms, which
the solver uses, are canonical and carry shooting nodes behind x.
"""

from copy import copy
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from core.dynamics import ForceModel, force_model
from core.ephemeris import EphemerisTable, body_table
from core.orbits.spiral import departure_state
from core.orbits.target import is_target_ballistic, target_table, window_days
from core.problem import Problem
from core.transcription.builder import build_plan
from core.transcription.curvature import curvature
from core.transcription.evaluate import evaluate
from core.transcription.layout import STATE, Guess, Layout, Start, checked_vector, layout_of
from core.transcription.plan import OutageProfile, Structure
from core.world import World, world_of

Array = NDArray[np.float64]

#: Default number of shooting legs; a first trial of the method found 1, 25 and 50 worse.
DEFAULT_LEGS = 10

_ROOM_DAYS = 5.0

#: Default tolerance of the integrator: a 30-day thrusting arc is right to 20 m.
TOLERANCE = 3e-10
#: Tolerance of the integrator where a solution is closed, or checked for feasibility, clearance and
#: optimality: over 90 days the default one is off by up to a kilometre, this one by metres.
FINE_TOLERANCE = 1e-12


class Transcription:
    """One problem with fixed options; its evaluations are pure functions of their vectors.

    Parameters
    ----------
    problem : Problem
        The problem P_k.
    n_legs : int
        Shooting legs of the lifted form [-]; x and its defects do not depend on it.
    tolerance : float
        Of the integrator, relative and absolute in canonical units [-].
    profiles : tuple of k OutageProfile
        Controls held during the outages, see `core.transcription.plan`; none by default.
    start : Start
        Where the reference begins, if it is under way already; None: at the departure.
    """

    def __init__(
        self,
        problem: Problem,
        n_legs: int = DEFAULT_LEGS,
        tolerance: float = TOLERANCE,
        profiles: tuple[OutageProfile, ...] = (),
        start: Start | None = None,
    ) -> None:
        if not isinstance(n_legs, int) or n_legs < 1:
            raise ValueError(f"n_legs: expected an integer of at least 1, got {n_legs!r}")
        if not 1e-14 <= tolerance <= 1e-3:
            raise ValueError(f"tolerance: expected 1e-14 .. 1e-3, got {tolerance}")
        self.problem = problem
        self.world: World = world_of(problem)
        self.n_legs = n_legs
        self.tolerance = tolerance
        self.start = start
        self.layout: Layout = layout_of(problem)
        self.setting, begin = _setting(_alone(problem, start)), 0.0
        if start is not None:
            self.setting, begin = replace(self.setting, departure=start.state), start.time
        self.plain: Structure = build_plan(problem, self.layout, 1, profiles, begin=begin)
        self.lifted: Structure = build_plan(problem, self.layout, n_legs, profiles, begin=begin)
        #: The lifted form with throttle vectors for controls: the same variables otherwise, nodes included.
        self.vectors: Structure = build_plan(problem, self.layout, n_legs, profiles, True, begin)
        self.scale = self.layout.scale()
        #: (7,) units of a state: km, km/s, kg per canonical unit.
        self.state_scale: Array = self.world.units.state

    @property
    def n_variables(self) -> int:
        """Length of x."""
        return self.layout.n_variables

    @property
    def n_defects(self) -> int:
        """Number of defects: seven per trajectory."""
        return STATE * len(self.layout.trajectories)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of x, each (n_variables,) [days, rad, kg]."""
        return self.layout.bounds(self.problem, self.start_mass_kg)

    @property
    def sampling_box(self) -> tuple[Array, Array]:
        """Box from which guesses are drawn and which scales hops, each (n_variables,) [days, rad, kg]."""
        return self.layout.sampling_box(self.problem, self.start_mass_kg)

    @property
    def start_mass_kg(self) -> float:
        """Mass m(t0) [kg]."""
        return float(self.setting.departure[6] * self.world.units.mu_kg)

    @property
    def idle_coasts(self) -> list[int]:
        """Indices in x of the final coasts without effect: those on a ballistic target."""
        is_idle = is_target_ballistic(self.problem)
        return [trajectory.final_coast for trajectory in self.layout.trajectories if is_idle]

    def defects(self, x: Array) -> Array:
        """Return forward minus backward states at the matchpoints.

        Parameters
        ----------
        x : (n_variables,) array
            Decision vector [days, rad, kg].

        Returns
        -------
        (n_defects,) array
            (x, y, z [km], vx, vy, vz [km/s], m [kg]) of each trajectory, J2000; NaN when it cannot be flown.

        Raises
        ------
        ValueError
            When x has another shape or is not finite.
        """
        z = checked_vector(self.layout, x) / self.scale
        defects, _ = self.evaluate(self.plain, z, with_partials=False)
        return np.asarray(defects * np.tile(self.state_scale, self.n_defects // STATE))

    def jacobian(self, x: Array) -> "scipy.sparse.csr_array":
        """Return d defects / d x with a sparsity that does not depend on x.

        Parameters
        ----------
        x : (n_variables,) array
            Decision vector [days, rad, kg].

        Returns
        -------
        (n_defects, n_variables) CSR array
            Partials in the units of `defects` over those of x.

        Raises
        ------
        ValueError
            When x has another shape or is not finite.

        References
        ----------
        docs/method.md, eqs. 9-20.
        """
        z = checked_vector(self.layout, x) / self.scale
        _, values = self.evaluate(self.plain, z, with_partials=True)
        rows, columns = self.plain.rows, self.plain.columns
        values = values * self.state_scale[rows % STATE] / self.scale[columns]
        return scipy.sparse.csr_array((values, (rows, columns)), shape=(self.n_defects, self.n_variables))

    def at_tolerance(self, tolerance: float) -> "Transcription":
        """Return the same transcription with another tolerance of the integrator [-]."""
        other = copy(self)
        other.tolerance = tolerance
        return other

    def is_clear(self, x: Array) -> bool:
        """Return whether no trajectory of a decision vector passes too low over a body of the world.

        Only the ends of steps are looked at, which are further out than a closest approach between them.
        """
        solid = self.at_tolerance(FINE_TOLERANCE)
        # Where nothing pulls besides, the first body is the centre once more.
        lowest = [body.radius_km + body.lowest_km for body in (self.world.center, self.world.near)]
        radii = np.array(lowest) / self.world.units.lu_km
        solid.setting = replace(self.setting, model=self.setting.model._replace(surfaces=radii))
        return bool(np.all(np.isfinite(solid.defects(x))))

    def lift(self, guess: Array | Guess) -> Array:
        """Return the canonical lifted vector of a guess.

        Its nodes lie on the states that the guess brings along, and where it has none on the propagated
        halves of x, so that a guess without states leaves only the matchpoint defects open.
        """
        z = np.full(self.lifted.n_variables, np.nan)
        z[: self.n_variables] = checked_vector(self.layout, guess) / self.scale
        states = guess.states if isinstance(guess, Guess) else None
        for (trajectory, boundary), place in self.lifted.nodes.items():
            path = states[trajectory] if states is not None else None
            if path is not None:
                z[place : place + STATE] = path[boundary - 1]
        self.fill_nodes(self.lifted, z)
        return z

    def fill_nodes(self, structure: Structure, z: Array) -> None:
        """Set NaN nodes of a lifted vector to the end of the previous leg, where it can be propagated."""
        self._run(structure, z, lift=True, with_partials=False)

    def nodes_of(self, z: Array, trajectory: int) -> Array:
        """Return the (N_w + 1, 7) boundary states of a trajectory in a lifted vector, NaN without a node."""
        states = np.full((self.layout.trajectories[trajectory].n_segments + 1, STATE), np.nan)
        for (index, boundary), place in self.lifted.nodes.items():
            if index == trajectory:
                states[boundary - 1] = z[place : place + STATE]
        return states

    def drop_nodes(self, z: Array) -> Array:
        """Return x of a lifted vector."""
        return z[: self.n_variables] * self.scale

    def evaluate(self, structure: Structure, z: Array, with_partials: bool) -> tuple[Array, Array]:
        """Return canonical defects (7 n_blocks,) and values of the sparse Jacobian, NaN if not propagated."""
        return self._run(structure, z, lift=False, with_partials=with_partials)

    def hessian(self, structure: Structure, z: Array, multipliers: Array) -> Array:
        """Return the Hessian of multipliers . defects, canonical, NaN where it cannot be propagated.

        Parameters
        ----------
        structure : Structure
            `plain` or `lifted`.
        z : (n_variables,) array
            Canonical variables.
        multipliers : (7 n_blocks,) array
            Weights of the canonical defects [-].

        Returns
        -------
        (n_nonzeros,) array
            Its lower triangle at `structure.hessian_rows` and `structure.hessian_columns`.

        References
        ----------
        docs/method.md, eqs. 25-35.
        """
        setting, pattern = self.setting, structure.pattern
        values = np.empty(len(pattern.rows))
        status = curvature(
            setting.model, setting.target, setting.departure, structure.plan, pattern, z, self.tolerance,
            multipliers, values,
        )  # fmt: skip
        if status < 0:
            values[:] = np.nan
        return values

    def _run(self, structure: Structure, z: Array, lift: bool, with_partials: bool) -> tuple[Array, Array]:
        plan, setting = structure.plan, self.setting
        ends = np.zeros((len(plan.leg_start), STATE))
        defects = np.empty(STATE * len(plan.block_plus))
        values = np.empty(plan.block_values[-1] if with_partials else 0)
        status = evaluate(
            setting.model, setting.target, setting.departure, plan, z, self.tolerance, lift, with_partials,
            ends, defects, values,
        )  # fmt: skip
        if status < 0:
            defects[:] = np.nan
            values[:] = np.nan
        return defects, values[structure.places] if with_partials else values


@dataclass(frozen=True, slots=True, eq=False)
class _Setting:
    """The data shared by all P_k of a family."""

    model: ForceModel
    target: EphemerisTable
    departure: Array


@lru_cache(maxsize=8)
def _setting(reference: Problem) -> _Setting:
    et, position, velocity, mass = departure_state(reference.departure, reference.spacecraft)
    start, stop = window_days(reference)
    world, target = world_of(reference), target_table(reference)
    # Room for pictures that follow the target past the latest arrival, as far as the bodies are known.
    room = _ROOM_DAYS if world.kernel is None else 0.0
    bodies = body_table(et, min(start, -room), stop + room, is_fine=True, world=world)
    departure = np.concatenate([position, velocity, [mass]]) / world.units.state
    return _Setting(force_model(reference, bodies), target, departure)


def transcribe(
    problem: Problem,
    n_legs: int = DEFAULT_LEGS,
    tolerance: float = TOLERANCE,
    profiles: tuple[OutageProfile, ...] = (),
    start: Start | None = None,
) -> Transcription:
    """Return the transcription of a problem; see `Transcription` for the parameters."""
    _compile(_alone(problem, start))
    return Transcription(problem, n_legs, tolerance, profiles, start)


def _alone(problem: Problem, start: Start | None) -> Problem:
    """Return the reference problem whose departure, bodies and target a transcription flies with."""
    return (problem if start is None else start.problem).model_copy(update={"outages": ()})


@lru_cache(maxsize=8)
def _compile(reference: Problem) -> None:
    """Evaluate once all that a solve evaluates, so that compilation does not count as part of the solve."""
    transcription = Transcription(reference)
    lower, upper = transcription.bounds
    z = transcription.lift(0.5 * (lower + upper))
    for structure in (transcription.lifted, transcription.vectors):
        for with_partials in (False, True):
            defects, _ = transcription.evaluate(structure, z, with_partials)
    transcription.hessian(transcription.lifted, z, np.ones_like(defects))
