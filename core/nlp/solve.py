"""The local solver pi: from a guess to a solution, or a status that says why there is none."""

from collections.abc import Iterator
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from core.nlp.descent import State, ThrustVectors, is_solved, reach, starts
from core.nlp.feasibility import close_finely, is_feasible, outcome_of
from core.nlp.ipopt import failure, one_thread, optimize
from core.nlp.outcome import CHEAPEST, ExitStatus, Limits, Outcome, SolveSettings, Stop
from core.nlp.recoveries import box_of, recovery, rejoin, to_realization, to_recovery
from core.nlp.robust import Deepen, Robust
from core.problem import require_departure_mass
from core.tolerances import violation
from core.transcription import FINE_TOLERANCE, Guess, ReferencePath, TrajectoryLayout, Transcription

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
    do not close move the reference, and are optimized together with it.  If the settings ask for it, the
    cheapest recovery from each outage is then sought with the reference as it is.  Meanwhile the numerical
    libraries of the process run one thread.

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
    settings = settings or SolveSettings()
    limits = limits_of(transcription, settings, stop)
    with one_thread():
        robust = Robust.of(transcription, guess, limits, deepen)
        status = _start(robust)
        if robust.is_started:
            status = _realize(robust, status)
        robust.finish()
        outcome = outcome_of(transcription, robust.x, status, limits)
        if outcome.is_feasible and transcription.problem.k and settings.recoveries == CHEAPEST:
            found = outcome_of(transcription, cheapen(transcription, outcome.x, limits), status, limits)
            outcome = found if found.is_feasible else outcome
        return outcome


def limits_of(transcription: Transcription, settings: SolveSettings, stop: Stop) -> Limits:
    """Return the budget of a solve of P_k: k + 1 times that of P_0."""
    share = 1 + transcription.problem.k
    return Limits(settings.cpu_seconds * share, settings.max_iterations * share, stop)


def _start(robust: Robust, most: int | None = None) -> ExitStatus:
    """Close and optimize the reference on its own, from at most so many starts."""
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
    return _from_starts(robust, form, z, most)


def _from_starts(robust: Robust, form: ThrustVectors, z: Array, most: int | None) -> ExitStatus:
    """Close and optimize the reference from one start after the other until one leads to an optimum."""
    alone, limits, found = form.transcription, robust.limits, []
    status, tried = ExitStatus.LOCALLY_INFEASIBLE, [robust.reference]
    for start in islice(starts(form, z), most):
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


#: Extra propellant with which a recovery is cheap enough after its first start, and after its second, as
#: shares of the wet mass [-]: 1 and 5 kg of the flagship's.
_CHEAP, _FAIR = 1.0 / 15000.0, 5.0 / 15000.0
#: Iterations of a start.
_START_ITERATIONS = 700
#: Times of further starts, as shares of what their bounds leave: of the shooting time, from what is left of
#: the reference's, below zero towards none; and of the initial coast.
_OTHER_TIMES = ((0.4, 0.35), (0.9, 0.1), (-0.3, 0.0))


def cheapen(transcription: Transcription, x: Array, limits: Limits) -> Array:
    """Return a solution with the cheapest recovery found for each outage, its reference to the last bit.

    Parameters
    ----------
    transcription : Transcription
        P_k.
    x : (n_variables,) array
        Its solution [days, rad, kg].
    limits : Limits
        Work left; counted here.

    References
    ----------
    docs/method.md, section 7.
    """
    path, found = ReferencePath(transcription.at_tolerance(FINE_TOLERANCE), x), x.copy()
    final_mass, unit = x[transcription.layout.reference.final_mass], transcription.world.units.mu_kg
    for own in transcription.layout.trajectories[1:]:
        part = recovery(transcription, path, own)
        for number, guess in enumerate(_guesses(transcription, own, path, found)):
            recovered = _alone(part, guess, limits)
            if recovered is not None and recovered[-1] > found[own.final_mass]:
                found[own.offset : own.stop] = to_realization(transcription, own, recovered)
            extra = (final_mass - found[own.final_mass]) / unit
            if limits.is_over or extra <= (_FAIR if number else _CHEAP):
                break
    return found


def _guesses(
    transcription: Transcription, own: TrajectoryLayout, path: ReferencePath, x: Array
) -> Iterator[Guess]:
    """Yield what is left of the reference, the realization as it is, and the first at other times."""
    reference = transcription.layout.reference
    assert own.outage is not None
    over = path.boundary_time(own.outage.segment) + own.outage.duration_days / path.tu_days
    rest = (float(x[reference.final_coast]), float(x[reference.final_mass]))
    part, states = rejoin(transcription, own, path, over, rest)
    yield Guess(to_recovery(own, part), (states,))
    yield Guess(to_recovery(own, x[own.offset : own.stop]))
    lower, upper = box_of(transcription, own)
    for shooting, initial in _OTHER_TIMES:
        other = part.copy()
        other[0] += shooting * (upper[0] - part[0] if shooting > 0.0 else part[0])
        other[1] = lower[1] + initial * (upper[1] - lower[1])
        yield Guess(to_recovery(own, np.clip(other, lower, upper)))


def _alone(part: Transcription, guess: Guess, limits: Limits) -> Array | None:
    """Return the variables of a transfer with the least propellant near a guess, if it closes."""
    budget = min(_START_ITERATIONS, limits.iteration_budget - limits.iterations)
    own = Limits(limits.cpu_budget - limits.cpu_used, budget, limits.stop)
    robust = Robust.of(part, guess, own, None)
    _start(robust, 1)
    robust.finish()
    limits.iterations += own.iterations
    limits.evaluations += own.evaluations
    return robust.x if is_feasible(part, robust.x) else None
