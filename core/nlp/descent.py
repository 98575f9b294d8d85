"""One Gauss-Newton step of the descent, with corrections for the curvature of the defects.

A step minimizes the cost's quadratic model, with damping, on the linearized defects (a small elastic error
allowed); its Hessian is diagonal up to one direction per segment, so a step costs one small Cholesky
factorization.  Corrections for the curvature of the defects reuse the factor: without them
the steps creep along curved valleys, the more so near the Moon.
"""

from dataclasses import dataclass, field

import numpy as np
import scipy
from numpy.typing import NDArray

from core.nlp.cost import Cost
from core.nlp.limits import Limits
from core.nlp.thrust_vectors import ThrustVectors

Array = NDArray[np.float64]

#: Norm of the canonical defects below which they count as closed: 400 m, all legs together; the most
#: sensitive paths come no closer.  Others are closed on, to the second value.
CLOSED, WELL_CLOSED = 1e-6, 1e-12

# Price of the norm of the defects against the cost, and corrections of a step.
_PRICE, _CORRECTIONS = 100.0, 2
# A step is taken when it gains so much of what was predicted; damping changes beyond the other two.
_TAKEN, _POOR, _GOOD = 0.01, 0.25, 0.7
_MORE_DAMPING, _LESS_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 3.0, 0.2, 1e-5, 1e13


@dataclass(slots=True, eq=False)
class State:
    """Where the descent stands: the point, its defects and Jacobian, and the damping."""

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
        """Whether no step is left that could gain anything."""
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
    """Try one step and adapt the damping; return what was gained of cost and priced defects.

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
    trial, gained = _corrected(model, cost, step, linear, now, _GOOD * predicted, limits)
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


def _corrected(
    model: _Model, cost: Cost, step: Array, linear: Array, now: float, enough: float, limits: Limits
) -> tuple[Array, float]:
    """Return the end of a step and its gain, corrected while that gains more and is not yet enough."""
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
