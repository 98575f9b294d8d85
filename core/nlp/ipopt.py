"""IPOPT with exact second derivatives: from closed defects to the local optimum nearby.

Descent and IPOPT take turns until no turn gains propellant, on one thread of the numerical libraries.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.nlp.descent import State, ThrustVectors, close, is_solved, node_scales, save_propellant
from core.nlp.outcome import ExitStatus, Limits
from core.nlp.robust import JOINT_ITERATIONS, Robust
from core.transcription import Guess, Structure, Transcription, wrapped

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Largest canonical defect of an optimum: 4 m, 1e-8 km/s.
CLOSED = 1e-8

#: Weight of the final mass in the objective: a throttle of a segment then weighs some 4e-3.
WEIGHT = 10.0

#: Iterations in which a point is to become optimal.
MOST_ITERATIONS = 300

# A variable lies at its bound if it is this close and the bound's multiplier is the greater of the two.
_AT_BOUND = 1e-4

# A final coast whose partials add up to less has no effect.
_DEAD = 1e-4

#: Measured on ppe-drm3, docs/decisions/0001-local-solver.md.
OPTIONS: dict[str, str | float | int] = {
    "print_level": 0,
    "sb": "yes",
    "mu_strategy": "monotone",
    "mu_init": 1e-5,
    "bound_push": 1e-7,
    "bound_frac": 1e-7,
    "bound_relax_factor": 0.0,
    "theta_min_fact": 1e-7,
    "theta_max_fact": 1e-2,
    "tol": 1e-9,
    "constr_viol_tol": CLOSED,
    "nlp_scaling_method": "none",
}


@dataclass(frozen=True, slots=True, eq=False)
class PolishedPoint:
    """The result of IPOPT from a point."""

    #: Decision vector where IPOPT ended, and its lifted form; closed if optimal.
    x: Array
    z: Array
    #: Whether it is a local optimum to IPOPT's tolerance.
    is_optimal: bool


@dataclass(slots=True, eq=False)
class _Callbacks:
    """The lifted problem in scaled variables; values are cached, since IPOPT requests each separately."""

    transcription: Transcription
    limits: Limits
    scale: Array
    last_iteration: int
    _at: bytes = b""
    _partials_at: bytes = b""
    _defects: Array = field(default_factory=lambda: np.empty(0))
    _values: Array = field(default_factory=lambda: np.empty(0))

    @property
    def mass(self) -> int:
        return self.transcription.layout.reference.final_mass

    @property
    def _form(self) -> Structure:
        return self.transcription.lifted

    def objective(self, w: Array) -> float:
        return float(-WEIGHT * w[self.mass] * self.scale[self.mass])

    def gradient(self, w: Array) -> Array:
        gradient = np.zeros(len(w))
        gradient[self.mass] = -WEIGHT * self.scale[self.mass]
        return gradient

    def constraints(self, w: Array) -> Array:
        key = w.tobytes()
        if key != self._at:
            self._defects, _ = self.transcription.evaluate(self._form, w * self.scale, with_partials=False)
            self._at = key
            self.limits.evaluations += 1
        return self._defects

    def jacobianstructure(self) -> tuple[Indices, Indices]:
        return self._form.rows, self._form.columns

    def jacobian(self, w: Array) -> Array:
        key = w.tobytes()
        if key != self._partials_at:
            self._defects, values = self.transcription.evaluate(
                self._form, w * self.scale, with_partials=True
            )
            self._values = values * self.scale[self._form.columns]
            self._at = self._partials_at = key
            self.limits.evaluations += 1
        return self._values

    def hessianstructure(self) -> tuple[Indices, Indices]:
        return self._form.hessian_rows, self._form.hessian_columns

    def hessian(self, w: Array, multipliers: Array, weight: float) -> Array:
        # The objective is linear.
        rows, columns = self.hessianstructure()
        values = self.transcription.hessian(self._form, w * self.scale, multipliers)
        return np.asarray(values * self.scale[rows] * self.scale[columns])

    def intermediate(
        self,
        alg_mod: int,
        iter_count: int,
        obj_value: float,
        inf_pr: float,
        inf_du: float,
        mu: float,
        d_norm: float,
        regularization_size: float,
        alpha_du: float,
        alpha_pr: float,
        ls_trials: int,
    ) -> bool:
        if iter_count > 0:
            self.limits.iterations += 1
        return not (self.limits.is_over or self.limits.iterations >= self.last_iteration)


def polish(transcription: Transcription, guess: Array | Guess, limits: Limits) -> PolishedPoint:
    """Converge to the local optimum near a point whose defects are closed.

    Parameters
    ----------
    transcription : Transcription
        The problem; its lifted form is solved.
    guess : (n_variables,) array or Guess
        The point [days, rad, kg].
    limits : Limits
        Work left; counted here.

    Returns
    -------
    PolishedPoint
        Never raises for a failed solve.
    """
    import cyipopt  # Half of core's import time; a coordinator never solves.

    z, scale = transcription.lift(guess), node_scales(transcription)
    lower, upper = _bounds(transcription, z)
    n_rows = 7 * len(transcription.lifted.plan.block_plus)
    last = limits.iterations + MOST_ITERATIONS * (1 + transcription.problem.k)
    callbacks = _Callbacks(transcription, limits, scale, last)
    zeros = np.zeros(n_rows)
    problem = cyipopt.Problem(
        n=len(z), m=n_rows, problem_obj=callbacks, lb=lower / scale, ub=upper / scale, cl=zeros, cu=zeros
    )
    for name, value in OPTIONS.items():
        problem.add_option(name, value)
    w, info = problem.solve(np.clip(z, lower, upper) / scale)
    if info["status"] == 0:
        w = _on_bounds(w, info, lower / scale, upper / scale)
        return PolishedPoint(_decision(transcription, w * scale), w * scale, is_optimal=True)
    return PolishedPoint(_decision(transcription, w * scale), w * scale, is_optimal=False)


def _on_bounds(w: Array, info: dict[str, Any], lower: Array, upper: Array) -> Array:
    """Return a solution with variables put on their active bounds, which IPOPT only approaches."""
    below, above = w - lower, upper - w
    w = np.where((below < _AT_BOUND) & (below < info["mult_x_L"]), lower, w)
    return np.where((above < _AT_BOUND) & (above < info["mult_x_U"]), upper, w)


def _bounds(transcription: Transcription, z: Array) -> tuple[Array, Array]:
    """Return the box; angles, whose bounds are seams of the sphere, are free here; idle coasts are fixed."""
    lower, upper = np.full(len(z), -1e19), np.full(len(z), 1e19)
    for bound, side in zip((lower, upper), transcription.bounds, strict=True):
        bound[: transcription.n_variables] = side / transcription.scale
    form = transcription.lifted
    _, values = transcription.evaluate(form, z, with_partials=True)
    effect, idle = np.bincount(form.columns, np.abs(values), len(z)), transcription.idle_coasts
    for trajectory in transcription.layout.trajectories:
        for angle in (1, 2):
            places = slice(trajectory.controls.start + angle, trajectory.controls.stop, 3)
            lower[places], upper[places] = -1e19, 1e19
        # Coasting on a ballistic target changes nothing, and the barrier would only centre it.
        coast = trajectory.final_coast
        if coast in idle or effect[coast] < _DEAD:
            lower[coast] = upper[coast] = np.clip(z[coast], lower[coast], upper[coast])
    return lower, upper


def _decision(transcription: Transcription, z: Array) -> Array:
    """Return x with angles inside their box."""
    x = transcription.drop_nodes(z)
    for trajectory in transcription.layout.trajectories:
        x[trajectory.controls] = wrapped(x[trajectory.controls].reshape(-1, 3)).ravel()
    return x


#: Legs of the form in which propellant is saved: shorter ones bend less.
OPTIMUM_LEGS = 20
#: Most rounds of descent and IPOPT until the optimum is found.
ROUNDS = 3
#: Mass that a round must gain for another to follow, as a share of the wet mass [-]: 100 g of the flagship's.
LEAST_GAIN = 0.1 / 15000.0


def optimize(robust: Robust, is_near: bool) -> ExitStatus:
    """Save propellant with the realizations that act on the reference, then converge to the optimum.

    Parameters
    ----------
    robust : Robust
        Its reference and acting realizations are closed; they are replaced by better ones.
    is_near : bool
        Whether they are taken to be optimal, or nearly so: then there is no descent.

    Returns
    -------
    ExitStatus
        OPTIMAL, ACCEPTABLE short of that, STALLED if nothing was gained, IMPACT, or which limit came.
    """
    limits, acting = robust.limits, robust.acting
    part = robust.together(acting, max(OPTIMUM_LEGS, robust.transcription.n_legs))
    form = ThrustVectors(part)
    is_settled = is_near
    for _ in range(1 if is_near else ROUNDS):
        before = robust.final_mass
        if not is_near:
            state = State(form, form.start(robust.guess(acting)), 1.0)
            save_propellant(state, limits)
            if is_solved(state):
                is_settled |= robust.improve(part, form.decision(state.z), state.z)
            if not part.is_clear(robust.vector(acting)):
                return ExitStatus.IMPACT
        polished = polish(part, robust.guess(acting), limits)
        if polished.is_optimal:
            if robust.improve(part, polished.x, polished.z):
                return ExitStatus.OPTIMAL
            # The optimum lies inside a body, or is too sensitive to be propagated.
            break
        if limits.is_over:
            return failure(limits)
        is_settled |= _close_again(robust, form, polished)
        if robust.final_mass < before + LEAST_GAIN * part.world.units.mu_kg:
            break
    return ExitStatus.ACCEPTABLE if is_settled else ExitStatus.STALLED


def _close_again(robust: Robust, form: ThrustVectors, polished: PolishedPoint) -> bool:
    """Accept IPOPT's last iterate short of the optimum if it can be closed and is better; return whether."""
    nodes = tuple(form.transcription.nodes_of(polished.z, i) for i in range(1 + len(robust.acting)))
    state = close(form, form.start(Guess(polished.x, nodes)), robust.limits, JOINT_ITERATIONS)
    return is_solved(state) and robust.improve(form.transcription, form.decision(state.z), state.z)


def failure(limits: Limits) -> ExitStatus:
    """Return why defects stay open, or why the optimum was not reached."""
    if limits.is_stopped:
        return ExitStatus.STOPPED
    if limits.is_late:
        return ExitStatus.TIMEOUT
    return ExitStatus.ITERATION_LIMIT if limits.is_over else ExitStatus.LOCALLY_INFEASIBLE


@contextmanager
def one_thread() -> Iterator[None]:
    """Hold the numerical libraries of this process to one thread.

    The matrices of a solve are small: more threads make it three times slower, and give other last bits.
    """
    # Before the limit is set: a library that is loaded later begins with as many threads as there are cores.
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        yield
