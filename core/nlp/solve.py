"""The local solver pi: from a guess to a solution, or a status that says why there is none."""

import numpy as np
from numpy.typing import NDArray

from core.nlp.descent import State, ThrustVectors, is_solved, reach, starts
from core.nlp.feasibility import close_finely, is_feasible, outcome_of
from core.nlp.ipopt import failure, one_thread, optimize
from core.nlp.outcome import ExitStatus, Limits, Outcome, SolveSettings, Stop
from core.nlp.robust import Deepen, Robust
from core.problem import require_departure_mass
from core.tolerances import violation
from core.transcription import Guess, Transcription

Array = NDArray[np.float64]


def no_stop() -> bool:
    """Return that no stop is asked for."""
    return False


def solve(
    transcription: Transcription,
    guess: Array | Guess,
    settings: SolveSettings | None = None,
    stop: Stop = no_stop,
    deepen: Deepen | None = None,
) -> Outcome:
    """Solve P_k from a guess.

    The reference is closed and optimized on its own, then each realization is closed against it; those that
    do not close move the reference, and are optimized together with it.  Meanwhile the numerical libraries of
    the process run one thread.

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
        When the guess has another shape or is not finite, or the departure has no propellant.

    References
    ----------
    docs/method.md, section 7.
    """
    require_departure_mass(transcription.problem, transcription.start_mass_kg)
    limits = limits_of(transcription, settings or SolveSettings(), stop)
    with one_thread():
        robust = Robust.of(transcription, guess, limits, deepen)
        status = _start(robust)
        if robust.is_started:
            status = _realize(robust, status)
        robust.finish()
        return outcome_of(transcription, robust.x, status, limits)


def limits_of(transcription: Transcription, settings: SolveSettings, stop: Stop) -> Limits:
    """Return the budget of a solve of P_k: k + 1 times that of P_0."""
    share = 1 + transcription.problem.k
    return Limits(settings.cpu_seconds * share, settings.max_iterations * share, stop)


def _start(robust: Robust) -> ExitStatus:
    """Close and optimize the reference on its own."""
    alone = robust.together([])
    form = ThrustVectors(alone)
    z = form.start(robust.guess([]))
    if not np.all(np.isfinite(z)):
        return ExitStatus.NOT_FINITE
    state = State(form, z, 1.0)
    if is_solved(state):
        # A guess that is already closed, such as a seed, was optimal before: it is only polished.
        robust.start_from(form.decision(z), alone.nodes_of(z, 0))
        return optimize(robust, is_near=True)
    return _from_starts(robust, form, z)


def _from_starts(robust: Robust, form: ThrustVectors, z: Array) -> ExitStatus:
    """Close and optimize the reference from one start after the other until one leads to an optimum."""
    alone, limits, found = form.transcription, robust.limits, []
    status, tried = ExitStatus.LOCALLY_INFEASIBLE, [robust.reference]
    for start in starts(form, z):
        state = reach(form, start, limits)
        tried.append(form.decision(state.z))
        if is_solved(state):
            robust.take([], alone, form.decision(state.z), state.z)
            status = optimize(robust, is_near=False)
            if is_feasible(alone, close_finely(alone, robust.reference)):
                found.append((robust.final_mass, status, robust.reference, robust.path))
        if limits.is_over or (found and status is ExitStatus.OPTIMAL):
            break
    if not found:
        # The least infeasible, for those who hop from it.
        robust.fall_back(
            min(tried, key=lambda x: violation(alone.defects(x).reshape(-1, 7), alone.world.strict))
        )
        return ExitStatus.IMPACT if status is ExitStatus.IMPACT else failure(limits)
    _, status, reference, path = max(found, key=lambda entry: entry[0])
    robust.start_from(reference, path)
    return status


def _realize(robust: Robust, status: ExitStatus) -> ExitStatus:
    """Close the realizations; those that do not close against the reference join it."""
    members = range(robust.transcription.problem.k)
    for _ in range(len(members) + 1):
        opened = [i for i in members if i not in robust.acting and not robust.close_alone(i)]
        if not opened:
            break
        for i in opened:
            if not robust.join(i):
                return failure(robust.limits)
        status = optimize(robust, is_near=False)
    return status
