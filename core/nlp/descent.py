"""Descent: Gauss-Newton steps on a lifted problem with throttle vectors until its defects close.

It has the phases of a solve: reach the target, respect the thrust limit, save propellant.

z is canonical.  A throttle vector has no singular direction where a segment coasts, and its length may pass
1 on the way to a solution.  A step minimizes the quadratic model of a cost of throttles and shooting time,
with damping, on the linearized defects (a small elastic error allowed); its Hessian is diagonal up to one
direction per segment, so a step costs one small Cholesky factorization.  Corrections for the curvature of the
defects reuse the factor: without them the steps creep along curved valleys, the more so near the Moon.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import scipy
from numpy.typing import NDArray

from core.nlp.outcome import Limits
from core.transcription import STATE, Guess, TrajectoryLayout, Transcription, control_of, throttle_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

# Scales of a step [LU, VU, MU, TU], tuned: solves diverge if nodes move ten times as far.
_NODE_POSITION, _NODE_VELOCITY, _MASS, _TIME = 0.03, 0.1, 0.1, 0.1
# A time between bounds that are so much closer to each other than to zero is fixed [-].
_FIXED = 1e-3
# Kept between a time and its bound, so that rounding does not pass it [TU].
_MARGIN = 1e-6
_LEAST_MASS = 1e-3


class ThrustVectors:
    """Indices, scales and evaluations of one transcription's problem in z.

    Parameters
    ----------
    transcription : Transcription
        The problem.
    is_reference_fixed : bool
        Whether only the realizations may move, and only their defects count.
    """

    def __init__(self, transcription: Transcription, is_reference_fixed: bool = False) -> None:
        self.transcription = transcription
        structure, layout = transcription.vectors, transcription.layout
        self.n_segments = layout.reference.n_segments
        trajectories = layout.trajectories
        #: (n_controls, 3) places of the throttle vectors, the reference's first; (3 (k + 1),) of the times.
        self.controls: Indices = np.concatenate(
            [np.arange(t.controls.start, t.controls.stop) for t in trajectories]
        ).reshape(-1, 3)
        self.times: Indices = np.concatenate([np.arange(t.offset, t.offset + 3) for t in trajectories])
        #: (n_others,) places of all that is no control.
        self.others: Indices = np.setdiff1d(np.arange(structure.n_variables), self.controls.ravel())
        #: (k + 1,) trajectories that may move.
        self.is_free = [not is_reference_fixed] + (len(trajectories) - 1) * [True]
        free = self._free()
        #: (n_controls,) and (n_others,) what may move.
        self.free_controls: Mask = free[self.controls[:, 0]]
        self.free_others: Mask = free[self.others]
        #: (n_variables,) lengths by which steps are measured.
        self.scale = node_scales(transcription)
        touched = np.zeros(STATE * len(structure.plan.block_plus), dtype=bool)
        touched[structure.rows[free[structure.columns]]] = True
        #: (n_defects,) rows of the defects that what may move acts on.
        self.rows: Indices = np.flatnonzero(touched)
        self.n_defects = len(self.rows)
        # That of the reference is left to the phase that saves propellant, which realizations do not have.
        masses = np.array([t.final_mass for t in trajectories[1:]], dtype=np.int64)
        lower, upper = (side / transcription.scale for side in transcription.bounds)
        lower[self.times] += _MARGIN
        upper[self.times] -= _MARGIN
        # What is flown from the departure has no more mass than that.
        upper[masses] = np.inf
        bounded = np.sort(np.concatenate([self.times, masses]))
        #: Places of the times [TU] and of realizations' final masses [MU] that may move, and how far.
        self.bounded: Indices = bounded[free[bounded]]
        self.lowest, self.highest = lower[self.bounded], upper[self.bounded]
        #: Which of these are shooting times.
        self.is_shooting: Mask = np.isin(self.bounded, [t.shooting_time for t in trajectories])
        #: Whether there is nothing to choose: then all starts would be the same.
        spans = (self.highest - self.lowest)[self.is_shooting]
        self.is_time_fixed = bool(np.all(spans < _FIXED * self.highest[self.is_shooting]))
        #: Bounds of the throttles [-].
        self.least, self.most = transcription.problem.bounds.throttle
        setting = transcription.setting
        #: Mass flow at full throttle [MU/TU].
        self.flow = setting.model.max_thrust / setting.model.exhaust_velocity

    def start(self, guess: Array | Guess) -> Array:
        """Return z of a guess; where it has no states, final masses are what its throttles leave."""
        z = self.transcription.lift(guess)
        z[self.controls] = throttle_of(z[self.controls])
        states = guess.states if isinstance(guess, Guess) else None
        for index in range(len(self.transcription.layout.trajectories)):
            if self.is_free[index] and (states is None or states[index] is None):
                self._balance_mass(z, index)
        self.transcription.fill_nodes(self.transcription.vectors, z)
        return z

    def lengthen(self, start: Array) -> Array:
        """Return a start with shooting times halfway to their upper bounds, propagated with its controls."""
        z = start.copy()
        places = self.bounded[self.is_shooting]
        z[places] += 0.5 * (self.highest[self.is_shooting] - z[places])
        for index in np.flatnonzero(self.is_free):
            self._balance_mass(z, int(index))
        self.transcription.fill_nodes(self.transcription.vectors, z)
        return z

    def decision(self, z: Array) -> Array:
        """Return x of z [days, rad, kg], inside its box."""
        x = z[: self.transcription.n_variables].copy()
        x[self.controls] = control_of(z[self.controls])
        lower, upper = self.transcription.bounds
        return np.clip(x * self.transcription.scale, lower, upper)

    def defects(self, z: Array) -> Array:
        """Return the canonical defects (n_defects,), NaN where z cannot be flown."""
        return self.transcription.evaluate(self.transcription.vectors, z, with_partials=False)[0][self.rows]

    def linearize(self, z: Array) -> tuple[Array, Array]:
        """Return the defects and their dense Jacobian (n_defects, n_variables)."""
        structure = self.transcription.vectors
        defects, values = self.transcription.evaluate(structure, z, with_partials=True)
        jacobian = np.zeros((len(defects), len(z)))
        jacobian[structure.rows, structure.columns] = values
        return defects[self.rows], jacobian[self.rows]

    def throttles(self, z: Array) -> Array:
        """Return the lengths (n_controls,) of the throttle vectors."""
        return np.asarray(np.sqrt((z[self.controls] ** 2).sum(axis=1)))

    def inside(self, z: Array) -> Array:
        """Return z projected into its bounds; the cost limits the lengths of throttle vectors."""
        z[self.bounded] = np.clip(z[self.bounded], self.lowest, self.highest)
        return z

    def _free(self) -> Mask:
        structure = self.transcription.vectors
        free = np.ones(structure.n_variables, dtype=bool)
        for index, trajectory in enumerate(self.transcription.layout.trajectories):
            free[trajectory.offset : trajectory.stop] = self.is_free[index]
        for (index, _), place in structure.nodes.items():
            free[place : place + STATE] = self.is_free[index]
        free[self.transcription.idle_coasts] = False
        return free

    def _balance_mass(self, z: Array, index: int) -> None:
        """Put the times inside their bounds, make the final mass consistent, and drop the nodes."""
        self.inside(z)
        transcription = self.transcription
        trajectory, reference = transcription.layout.trajectories[index], transcription.layout.reference
        mass = float(transcription.setting.departure[6])
        if trajectory.outage is not None:
            mass -= self._spent(z, reference, trajectory.outage.segment - 1)
        mass -= self._spent(z, trajectory, trajectory.n_segments)
        z[trajectory.final_mass] = max(mass, _LEAST_MASS)
        for (of, _), place in transcription.vectors.nodes.items():
            if of == index:
                z[place : place + STATE] = np.nan

    def _spent(self, z: Array, trajectory: TrajectoryLayout, n_segments: int) -> float:
        """Return the mass that a trajectory's first segments burn [MU]."""
        vectors = z[trajectory.controls].reshape(-1, 3)[:n_segments]
        share = z[trajectory.shooting_time] / trajectory.n_segments
        return float(self.flow * share * np.sqrt((vectors**2).sum(axis=1)).sum())


def node_scales(transcription: Transcription) -> Array:
    """Return the lengths (n_variables,) by which steps of a lifted vector are measured; controls have 1."""
    structure, layout = transcription.lifted, transcription.layout
    scale = np.ones(structure.n_variables)
    for trajectory in layout.trajectories:
        scale[trajectory.offset : trajectory.offset + 3] = _TIME
        scale[trajectory.final_mass] = _MASS
    for place in structure.nodes.values():
        scale[place : place + STATE] = [_NODE_POSITION] * 3 + [_NODE_VELOCITY] * 3 + [_MASS]
    return scale


#: Unit of the propellant in the cost [MU]: 100 kg, so that costs are of order 1.
_UNIT = 1.0 / 150.0


@dataclass(frozen=True, slots=True)
class Cost:
    """Energy or propellant, and a penalty on throttles beyond a limit; all smooth where segments coast."""

    #: Weight of the mean squared throttle of all controls, halved.
    energy: float = 0.0
    #: Whether the reference's propellant counts, and the throttle below which its kink is rounded.
    has_propellant: bool = False
    rounding: float = 0.1
    #: Weight of the squared excess over the limit, halved, in the mean over the reference's segments.
    penalty: float = 0.0
    #: The limit, as a fraction of the throttle's upper bound.
    limit: float = 0.97

    def value(self, form: ThrustVectors, z: Array) -> float:
        """Return the cost at z."""
        a, n = form.throttles(z), form.n_segments
        excess = self._excess(form, a)
        total = 0.5 * (self.energy * (a @ a) + self.penalty * (excess @ excess)) / n
        if self.has_propellant:
            total += self._rate(form) * z[form.times[0]] * self._burnt(a[:n]).sum()
        return float(total)

    def slope(self, form: ThrustVectors, z: Array, a: Array) -> tuple[Array, Array, Array]:
        """Return d cost / d throttle, and the curvatures across and along the throttle vectors."""
        n = form.n_segments
        length = np.maximum(a, 1e-12)
        excess = self._excess(form, a)
        slope = (self.energy * a + self.penalty * excess) / n
        # Below the lower bound the penalty is convex along the vector alone.
        across = (self.energy + self.penalty * np.maximum(excess, 0.0) / length) / n
        along = (self.energy + self.penalty * (excess != 0.0)) / n
        if self.has_propellant:
            rate, root = self._rate(form) * z[form.times[0]], np.sqrt(a[:n] ** 2 + self.rounding**2)
            slope[:n] += rate * a[:n] / root
            across[:n] += rate / root
            along[:n] += rate * self.rounding**2 / root**3
        return slope, across, along

    def by_shooting_time(self, form: ThrustVectors, a: Array) -> float:
        """Return d cost / d T_s of the reference."""
        return (
            self._rate(form) * float(self._burnt(a[: form.n_segments]).sum()) if self.has_propellant else 0.0
        )

    def _excess(self, form: ThrustVectors, a: Array) -> Array:
        """Return how far throttles exceed the limit, negative where they fall short of the lower bound."""
        least = min(form.least / self.limit, 0.5 * (form.least + form.most))
        return np.asarray(np.maximum(a - self.limit * form.most, 0.0) - np.maximum(least - a, 0.0))

    def _burnt(self, a: Array) -> Array:
        return np.asarray(np.sqrt(a * a + self.rounding**2) - self.rounding)

    def _rate(self, form: ThrustVectors) -> float:
        return form.flow / _UNIT / form.n_segments


#: Norm of the canonical defects of all legs below which they count as closed: 400 m; the most
#: sensitive paths come no closer.  Others are closed on, to the second value.
CLOSED, WELL_CLOSED = 1e-6, 1e-12

# Weight of the norm of the defects in the merit function, and most corrections of a step.
_PRICE, _CORRECTIONS = 100.0, 2
# A step is taken if it gains this fraction of the predicted decrease; damping changes beyond the other two.
_TAKEN, _POOR, _GOOD = 0.01, 0.25, 0.7
_MORE_DAMPING, _LESS_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 3.0, 0.2, 1e-5, 1e13


@dataclass(slots=True, eq=False)
class State:
    """The state of the descent: the point, its defects and Jacobian, and the damping."""

    form: ThrustVectors
    z: Array
    damping: float
    defects: Array = field(init=False)
    jacobian: Array = field(init=False)

    def __post_init__(self) -> None:
        """Linearize at the start."""
        self.defects, self.jacobian = self.form.linearize(self.z)

    @property
    def error(self) -> float:
        """Norm of the defects; NaN where z cannot be flown."""
        return float(np.linalg.norm(self.defects))

    @property
    def is_lost(self) -> bool:
        """Whether no step can decrease the merit function."""
        return not np.isfinite(self.error) or self.damping > _MOST_DAMPING

    def move(self, z: Array) -> None:
        """Go to a point and linearize there."""
        self.z = z
        self.defects, self.jacobian = self.form.linearize(z)


class _Model:
    """The quadratic model at a state: its minimizer on the linearized defects, and corrections of it."""

    def __init__(self, state: State, cost: Cost, rigidity: float) -> None:
        self.state, form = state, state.form
        self.form = form
        u = state.z[form.controls]
        a = form.throttles(state.z)
        slope, across, along = cost.slope(form, state.z, a)
        self.direction = u / np.maximum(a, 1e-12)[:, None]
        self.across = np.where(form.free_controls, across + state.damping, np.inf)
        self.along = np.where(form.free_controls, along + state.damping, np.inf)
        self.gradient = slope[:, None] * self.direction
        self.by_others = np.zeros(len(form.others))
        self.by_others[form.times[0]] = cost.by_shooting_time(form, a)
        self.j_controls = state.jacobian[:, form.controls]
        self.j_others = state.jacobian[:, form.others]
        self.softness = np.where(form.free_others, form.scale[form.others] ** 2 / state.damping, 0.0)
        spread = self._inverse(self.j_controls).reshape(form.n_defects, -1)
        self.flat = self.j_controls.reshape(form.n_defects, -1)
        self.metric = spread @ self.flat.T + np.eye(form.n_defects) / rigidity
        self.right = state.defects - spread @ self.gradient.ravel()

    def step(self) -> Array:
        """Return the minimizer; times and masses that would leave their bounds stop there."""
        form, state = self.form, self.state
        stopped = np.zeros(len(form.others))
        bounded = np.searchsorted(form.others, form.bounded)
        for _ in range(3):
            weighted = self.j_others * self.softness
            self.factor = scipy.linalg.cho_factor(
                self.metric + weighted @ self.j_others.T, check_finite=False
            )
            right = self.right + self.j_others @ stopped - weighted @ self.by_others
            multipliers = scipy.linalg.cho_solve(self.factor, right, check_finite=False)
            others = stopped - self.softness * (self.by_others + multipliers @ self.j_others)
            moved = state.z[form.bounded] + others[bounded]
            kept = np.clip(moved, form.lowest, form.highest)
            out = np.abs(kept - moved) > 1e-12
            if not out.any():
                break
            stopped[bounded[out]] = (kept - state.z[form.bounded])[out]
            self.softness[bounded[out]] = 0.0
        controls = -self._inverse(self.gradient + (multipliers @ self.flat).reshape(-1, 3))
        return self._assemble(others, controls)

    def correction(self, errors: Array) -> Array:
        """Return the step of least length in the model's metric that takes errors off the defects."""
        multipliers = scipy.linalg.cho_solve(self.factor, errors, check_finite=False)
        controls = -self._inverse((multipliers @ self.flat).reshape(-1, 3))
        return self._assemble(-self.softness * (multipliers @ self.j_others), controls)

    def length(self, step: Array) -> float:
        """Return the length of a step in the scales of its variables."""
        others = step[self.form.others] / self.form.scale[self.form.others]
        return float(np.hypot(np.linalg.norm(others), np.linalg.norm(step[self.form.controls])))

    def _inverse(self, x: Array) -> Array:
        """Return the controls' inverse Hessian times x (..., n_controls, 3)."""
        along = (x * self.direction).sum(axis=-1, keepdims=True) * self.direction
        return np.asarray((x - along) / self.across[:, None] + along / self.along[:, None])

    def _assemble(self, others: Array, controls: Array) -> Array:
        step = np.empty(len(self.state.z))
        step[self.form.others] = others
        step[self.form.controls] = controls
        return step


def advance(state: State, cost: Cost, rigidity: float, limits: Limits) -> float:
    """Try one step and adapt the damping; return the decrease of the merit function.

    Parameters
    ----------
    state : State
        Moved if the step is taken.
    cost : Cost
        Minimized on the defects.
    rigidity : float
        Weight of the squared error of the linearized defects, halved [-]: how exactly a step closes them.
    limits : Limits
        Where the work is counted.
    """
    limits.iterations += 1
    model = _Model(state, cost, rigidity)
    try:
        step = model.step()
    except scipy.linalg.LinAlgError:
        state.damping *= _MORE_DAMPING
        return 0.0
    now = _merit(state.form, cost, state.z, state.defects)
    linear = state.defects + state.jacobian @ step
    predicted = now - _merit(state.form, cost, state.form.inside(state.z + step), linear)
    trial, gained = _correct(model, cost, step, linear, now, _GOOD * predicted, limits)
    ratio = gained / predicted if predicted > 0.0 and np.isfinite(gained) else -1.0
    if ratio < _POOR:
        state.damping *= _MORE_DAMPING
    elif ratio > _GOOD:
        state.damping = max(_LEAST_DAMPING, _LESS_DAMPING * state.damping)
    if ratio <= _TAKEN:
        return 0.0
    state.move(trial)
    limits.evaluations += 1
    return gained


def _correct(
    model: _Model, cost: Cost, step: Array, linear: Array, now: float, enough: float, limits: Limits
) -> tuple[Array, float]:
    """Return the end of a step and its gain, with second-order corrections while they increase the gain."""
    form, z = model.form, model.state.z
    longest, best, gained, defects = model.length(step), z, -np.inf, linear
    for attempt in range(1 + _CORRECTIONS):
        if attempt > 0:
            correction = model.correction(defects - linear)
            if model.length(correction) > longest:
                break
            step = step + correction
        trial = form.inside(z + step)
        trial_defects = form.defects(trial)
        limits.evaluations += 1
        gain = now - _merit(form, cost, trial, trial_defects)
        if not gain > gained:
            break
        best, gained, defects = trial, gain, trial_defects
        if gained > enough:
            break
    return best, gained


def _merit(form: ThrustVectors, cost: Cost, z: Array, defects: Array) -> float:
    return cost.value(form, z) + _PRICE * float(np.linalg.norm(defects))


# All measured, docs/decisions/0001-local-solver.md.
_STAY, _REACH = Cost(), Cost(energy=1.0)
_RESPECT = Cost(penalty=100.0, limit=0.97)
_REFINE = Cost(penalty=1000.0, limit=0.9999)
_SAVE = tuple(
    Cost(has_propellant=True, rounding=rounding, penalty=1000.0, limit=0.995)
    for rounding in (0.1, 0.03, 0.01)
)
#: Iterations of the first phase, and of the first two together: attempts not closed by then are abandoned.
REACH_ITERATIONS, CLOSE_ITERATIONS = 120, 150
#: Starts made of a guess, each with the shooting time halfway from the last one's to its bound.
ATTEMPTS = 4
_REFINE_ITERATIONS = 60
_START_DAMPING, _NEAR = 1e4, 3e-3
_SOFT, _RIGID, _NEARER = 1e6, 1e9, 1e-3
# What rounding may add to the length of a throttle vector [-]: decisions are clipped to the bounds.
_ROUNDING = 1e-12
# Steps for a last metre that may be unreachable.
_MORE_STEPS, _TIGHTEN_ITERATIONS = 4, 8
# The propellant has settled when this many steps together gain less than this [MU / 150].
_PATIENCE, _SETTLED = 20, 1e-3


def starts(form: ThrustVectors, z: Array) -> Iterator[Array]:
    """Yield a start, then others that keep its coasts and controls but have more time to thrust.

    Whether a guess closes depends on its shooting time above all: with too little, throttles beyond 1 or
    defects remain, and the descent hardly lengthens it, since that moves the insertion epoch.
    """
    for _ in range(1 if form.is_time_fixed else ATTEMPTS):
        yield z
        z = form.lengthen(z)


def reach(form: ThrustVectors, z: Array, limits: Limits) -> State:
    """Close the defects from a distant guess: first without the thrust limit, then within it.

    Returns
    -------
    State
        Closed or not: `is_solved` tells.
    """
    state = State(form, z, _START_DAMPING)
    begun = limits.iterations
    while not (state.is_lost or limits.is_over or state.error < _NEAR):
        if limits.iterations - begun >= REACH_ITERATIONS:
            break
        advance(state, _REACH, _SOFT, limits)
    _respect(state, _RESPECT, limits, begun + CLOSE_ITERATIONS)
    return state


def close(form: ThrustVectors, z: Array, limits: Limits, most_iterations: int) -> State:
    """Close the defects within the thrust limit from nearby, by minimum-norm steps.

    Returns
    -------
    State
        Closed or not: `is_solved` tells.
    """
    state = State(form, z, 1.0)
    _respect(state, _RESPECT, limits, limits.iterations + most_iterations)
    return state


def tighten(form: ThrustVectors, z: Array, limits: Limits) -> State:
    """Close nearly closed defects by minimum-norm steps, throttles unchanged to rounding."""
    state = State(form, z, 1.0)
    for _ in range(_TIGHTEN_ITERATIONS):
        if state.error < WELL_CLOSED or state.is_lost or limits.is_over:
            break
        advance(state, _STAY, _RIGID, limits)
    return state


def save_propellant(state: State, limits: Limits) -> None:
    """Descend along the closed defects until the propellant settles or a limit comes."""
    state.damping = 1.0
    for cost in _SAVE:
        gains = [np.inf] * _PATIENCE
        while sum(gains[-_PATIENCE:]) >= _SETTLED and not (state.is_lost or limits.is_over):
            gains.append(advance(state, cost, _RIGID, limits))
        state.damping = min(state.damping, 1.0)
    _respect(state, _REFINE, limits, limits.iterations + _REFINE_ITERATIONS)


def is_solved(state: State) -> bool:
    """Return whether the defects are closed and all throttles that may move are within their bounds."""
    throttles = state.form.throttles(state.z)[state.form.free_controls]
    least, most = state.form.least - _ROUNDING, state.form.most + _ROUNDING
    return state.error < CLOSED and bool(np.all((throttles >= least) & (throttles <= most)))


def _respect(state: State, cost: Cost, limits: Limits, last: int) -> None:
    """Close the defects with throttles within the cost's limit, changing as little as possible."""
    state.damping = min(state.damping, 1.0)
    spare = _MORE_STEPS
    while not (state.is_lost or limits.is_over) and limits.iterations < last and spare > 0:
        if is_solved(state):
            if state.error < WELL_CLOSED:
                break
            spare -= 1
        advance(state, cost, _RIGID if state.error < _NEARER else _SOFT, limits)
