"""The phases of a solve by descent: reach the target, respect the thrust limit, save propellant."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from core.nlp.cost import Cost
from core.nlp.descent import CLOSED, WELL_CLOSED, State, advance
from core.nlp.limits import Limits
from core.nlp.thrust_vectors import ThrustVectors

Array = NDArray[np.float64]

# All measured, docs/decisions/0001-local-solver.md.
_STAY, _REACH = Cost(), Cost(energy=1.0)
_RESPECT = Cost(penalty=100.0, limit=0.97)
_REFINE = Cost(penalty=1000.0, limit=0.9999)
_SAVE = tuple(
    Cost(has_propellant=True, rounding=rounding, penalty=1000.0, limit=0.995)
    for rounding in (0.1, 0.03, 0.01)
)
#: Iterations of the first phase, and of the first two together: attempts not closed by then are given up.
REACH_ITERATIONS, CLOSE_ITERATIONS = 120, 150
#: Starts made of a guess, each with the shooting time halfway from the last one's to its bound.
ATTEMPTS = 4
_REFINE_ITERATIONS = 60
_START_DAMPING, _NEAR = 1e4, 3e-3
_SOFT, _RIGID, _NEARER = 1e6, 1e9, 1e-3
# What rounding may add to the length of a throttle vector [-]: decisions are cut to the bounds.
_ROUNDING = 1e-12
# Steps for a last metre that may be out of reach.
_MORE_STEPS, _TIGHTEN_ITERATIONS = 4, 8
# The propellant has settled when this many steps together gain less than this [100 kg].
_PATIENCE, _SETTLED = 20, 1e-3


def starts(form: ThrustVectors, z: Array) -> Iterator[Array]:
    """Yield a start, then others that keep its coasts and controls but have more time to thrust.

    Whether a guess closes depends on its shooting time above all: with too little, throttles beyond 1 or
    defects remain, and the descent hardly lengthens it, since that moves the insertion epoch.
    """
    for _ in range(ATTEMPTS):
        yield z
        z = form.lengthened(z)


def reach(form: ThrustVectors, z: Array, limits: Limits) -> State:
    """Close the defects from far away: first whatever the thrust, then within its limit.

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
    """Close the defects within the thrust limit from nearby, by the shortest steps that do.

    Returns
    -------
    State
        Closed or not: `is_solved` tells.
    """
    state = State(form, z, 1.0)
    _respect(state, _RESPECT, limits, limits.iterations + most_iterations)
    return state


def tighten(form: ThrustVectors, z: Array, limits: Limits) -> State:
    """Close defects that all but are by the shortest steps, throttles within rounding of where they were."""
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
    """Close the defects with throttles within the cost's limit, as near as possible."""
    state.damping = min(state.damping, 1.0)
    spare = _MORE_STEPS
    while not (state.is_lost or limits.is_over) and limits.iterations < last and spare > 0:
        if is_solved(state):
            if state.error < WELL_CLOSED:
                break
            spare -= 1
        advance(state, cost, _RIGID if state.error < _NEARER else _SOFT, limits)
