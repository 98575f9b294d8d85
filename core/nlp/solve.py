"""The local solver pi: from a guess to a solution, or to the reason why there is none."""

import numpy as np
from numpy.typing import NDArray

from core.nlp.descent import State
from core.nlp.judging import close_finely, is_feasible, outcome_of
from core.nlp.limits import Limits, Stop
from core.nlp.outcome import ExitStatus, Outcome, SolveSettings
from core.nlp.phases import close, is_solved, reach, save_propellant, starts
from core.nlp.polish import Polished, polish
from core.nlp.robust import JOINT_ITERATIONS, Deepen, Robust
from core.nlp.thrust_vectors import ThrustVectors
from core.transcription import Guess, Transcription, checked_vector

Array = NDArray[np.float64]


#: Legs of the form in which propellant is saved: shorter ones bend less.
OPTIMUM_LEGS = 20
#: How often the descent and IPOPT take turns until the optimum is found.
ROUNDS = 3
#: Mass that a round must gain for another to follow [kg].
LEAST_GAIN = 0.1


def never() -> bool:
    """Return that no stop is asked for."""
    return False


def solve(
    transcription: Transcription,
    guess: Array | Guess,
    settings: SolveSettings | None = None,
    stop: Stop = never,
    deepen: Deepen | None = None,
) -> Outcome:
    """Solve P_k from a guess.

    The reference is closed and optimized on its own, then each realization is closed against it; those that
    do not close move the reference, and are optimized together with it.

    Parameters
    ----------
    transcription : Transcription
        The problem.
    guess : (n_variables,) array or Guess
        Start in the paper layout [days, rad, kg]; what lies outside the bounds is moved to them first.
    settings : SolveSettings
        Limits; the defaults if None.
    stop : callable
        Asked once per iteration; true ends the solve with the best point so far.
    deepen : callable
        What is still flown during the outages of a problem at a depth between 0 and 1: with it, outages that
        do not close at once are deepened from nothing.

    Returns
    -------
    Outcome
        A solve that fails is a result too: its status says why.

    Raises
    ------
    ValueError
        When the guess has another shape or is not finite.

    References
    ----------
    docs/method.md, section 7.
    """
    limits = limits_of(transcription, settings or SolveSettings(), stop)
    robust = _taken_apart(transcription, guess, limits, deepen)
    status = _start(robust)
    if robust.is_started:
        status = _realize(robust, status)
    robust.finish()
    return outcome_of(transcription, robust.x, status, limits)


def limits_of(transcription: Transcription, settings: SolveSettings, stop: Stop) -> Limits:
    """Return the work that a solve of P_k may do: that of P_0, k + 1 times."""
    share = 1 + transcription.problem.k
    return Limits(settings.cpu_seconds * share, settings.max_iterations * share, stop)


def _taken_apart(
    transcription: Transcription, guess: Array | Guess, limits: Limits, deepen: Deepen | None
) -> Robust:
    lower, upper = transcription.bounds
    x = np.clip(checked_vector(transcription.layout, guess), lower, upper)
    ends = [trajectory.stop for trajectory in transcription.layout.trajectories]
    reference, *realizations = np.split(x, ends[:-1])
    states = guess.states if isinstance(guess, Guess) else None
    path, *others = states or (None,) * len(ends)
    return Robust(transcription, limits, deepen, reference, realizations, path, others)


def _start(robust: Robust) -> ExitStatus:
    """Close and optimize the reference on its own, from starts of the guess until one leads to an optimum."""
    alone, limits = robust.together([]), robust.limits
    form = ThrustVectors(alone)
    z = form.start(robust.guess([]))
    if not np.all(np.isfinite(z)):
        return ExitStatus.NOT_FINITE
    state = State(form, z, 1.0)
    if is_solved(state):
        # What arrives closed was optimal once, as seeds are: it is only polished.
        robust.take([], alone, form.decision(z), z)
        robust.is_started = True
        return _optimize(robust, is_near=True)
    status, found = ExitStatus.LOCALLY_INFEASIBLE, list[tuple[float, ExitStatus, Array, Array | None]]()
    for start in starts(form, z):
        state = reach(form, start, limits)
        if is_solved(state):
            robust.take([], alone, form.decision(state.z), state.z)
            status = _optimize(robust, is_near=False)
            if is_feasible(alone, close_finely(alone, robust.reference)):
                found.append((robust.final_mass, status, robust.reference, robust.path))
                robust.is_started = True
                if status is ExitStatus.OPTIMAL:
                    break
        if limits.is_over:
            break
    if not found:
        return ExitStatus.IMPACT if status is ExitStatus.IMPACT else _failure(limits)
    _, status, robust.reference, robust.path = max(found, key=lambda entry: entry[0])
    return status


def _realize(robust: Robust, status: ExitStatus) -> ExitStatus:
    """Close the realizations; those that do not close against the reference join it."""
    members = range(robust.transcription.problem.k)
    for _ in range(len(members) + 1):
        opened = [i for i in members if i not in robust.acting and not robust.close_alone(i)]
        if not opened:
            break
        for i in opened:
            together = sorted([*robust.acting, i])
            if not robust.close_together(together):
                return _failure(robust.limits)
            robust.acting = together
            robust.closed -= set(together)
        status = _optimize(robust, is_near=False)
    return status


def _optimize(robust: Robust, is_near: bool) -> ExitStatus:
    """Save propellant with the realizations that act on the reference, then converge to the optimum."""
    limits, acting = robust.limits, robust.acting
    part = robust.together(acting, max(OPTIMUM_LEGS, robust.transcription.n_legs))
    form = ThrustVectors(part)
    for _ in range(1 if is_near else ROUNDS):
        before = robust.final_mass
        if not is_near:
            state = State(form, form.start(robust.guess(acting)), 1.0)
            save_propellant(state, limits)
            if is_solved(state):
                robust.improve(part, form.decision(state.z), state.z)
            if not part.is_clear(robust.vector(acting)):
                return ExitStatus.IMPACT
        polished = polish(part, robust.guess(acting), limits)
        if polished.is_optimal:
            # Not taken: the optimum lies inside a body, or is too sensitive to be flown.
            is_taken = robust.improve(part, polished.x, polished.z)
            return ExitStatus.OPTIMAL if is_taken else ExitStatus.ACCEPTABLE
        if limits.is_over:
            return _failure(limits)
        _close_again(robust, form, polished)
        if robust.final_mass < before + LEAST_GAIN:
            break
    return ExitStatus.ACCEPTABLE


def _close_again(robust: Robust, form: ThrustVectors, polished: Polished) -> None:
    """Take where IPOPT stopped short of the optimum, if that can be closed and is better."""
    nodes = tuple(form.transcription.nodes_of(polished.z, i) for i in range(1 + len(robust.acting)))
    state = close(form, form.start(Guess(polished.x, nodes)), robust.limits, JOINT_ITERATIONS)
    if is_solved(state):
        robust.improve(form.transcription, form.decision(state.z), state.z)


def _failure(limits: Limits) -> ExitStatus:
    """Return why defects stay open, or why the optimum was not reached."""
    if limits.is_stopped:
        return ExitStatus.STOPPED
    if limits.is_late:
        return ExitStatus.TIMEOUT
    return ExitStatus.ITERATION_LIMIT if limits.is_over else ExitStatus.LOCALLY_INFEASIBLE
