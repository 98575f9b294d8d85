"""The local solver pi: from a guess to a solution, or to the reason why there is none."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from core.nlp.ipopt import Run, run_ipopt
from core.nlp.limits import Limits, Stop
from core.nlp.outcome import ExitStatus, Outcome, SolveSettings
from core.tolerances import violation
from core.transcription import Guess, Transcription, checked_vector

Array = NDArray[np.float64]

#: Weight of the final mass in the objective: measured, docs/decisions/0001-solver-settings.md.
WEIGHT = 0.1

#: Tolerance of the integrator when a solution is closed and judged: over 90 days the default one is off by
#: up to a kilometre, this one by metres.
FINE_TOLERANCE = 1e-12

# Another integrator must agree that the point is feasible, so defects are closed well below the tolerance.
_WELL_CLOSED, _TOO_FAR = 0.01, 1e4

_STATUS = {
    0: ExitStatus.OPTIMAL,
    1: ExitStatus.ACCEPTABLE,
    2: ExitStatus.LOCALLY_INFEASIBLE,
    3: ExitStatus.STALLED,
    -1: ExitStatus.ITERATION_LIMIT,
    -2: ExitStatus.STALLED,
    -3: ExitStatus.STALLED,
    -13: ExitStatus.NOT_FINITE,
}
_USER_STOP = 5
_ENDED_WELL = (ExitStatus.OPTIMAL, ExitStatus.ACCEPTABLE)


def never() -> bool:
    """Return that no stop is asked for."""
    return False


def solve(
    transcription: Transcription,
    guess: Array | Guess,
    settings: SolveSettings | None = None,
    stop: Stop = never,
) -> Outcome:
    """Solve P_k from a guess.

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

    Returns
    -------
    Outcome
        A solve that fails is a result too: its status says why.

    Raises
    ------
    ValueError
        When the guess has another shape or is not finite.
    """
    limits = limits_of(transcription, settings or SolveSettings(), stop)
    start = transcription.lift(_within(transcription, guess))
    if not np.all(np.isfinite(start)):
        return outcome_of(transcription, [transcription.drop_nodes(start)], ExitStatus.NOT_FINITE, limits)
    return optimize(transcription, start, limits)


def limits_of(transcription: Transcription, settings: SolveSettings, stop: Stop) -> Limits:
    """Return the work that a solve of P_k may do: that of P_0, k + 1 times."""
    share = 1 + transcription.problem.k
    return Limits(settings.cpu_seconds * share, settings.max_iterations * share, stop)


def optimize(transcription: Transcription, start: Array, limits: Limits) -> Outcome:
    """Solve from a finite lifted vector within limits that may already be partly used."""
    run = run_ipopt(transcription, start, WEIGHT, limits)
    candidates = [transcription.drop_nodes(z) for z in (run.z, run.closed) if z is not None]
    return outcome_of(transcription, candidates, _status(run, limits), limits)


def close_defects(
    transcription: Transcription, start: Array, limits: Limits, most_iterations: int
) -> Array | None:
    """Return a lifted vector near a start with all defects closed, or None if that fails soon.

    Parameters
    ----------
    transcription : Transcription
        The problem.
    start : (n,) array
        Canonical lifted vector.
    limits : Limits
        Work left; what this takes is counted there.
    most_iterations : int
        Iterations that this may take [-].
    """
    allowed = min(limits.iteration_budget, limits.iterations + most_iterations)
    step = replace(limits, iteration_budget=allowed)
    run = run_ipopt(transcription, start, WEIGHT, step, stop_when_closed=True)
    limits.iterations, limits.evaluations = step.iterations, step.evaluations
    limits.is_stopped = step.is_stopped
    return run.closed


def outcome_of(
    transcription: Transcription, candidates: list[Array], status: ExitStatus, limits: Limits
) -> Outcome:
    """Return the outcome with the best of some decision vectors, judged by their physical defects."""
    fine = transcription.at_tolerance(FINE_TOLERANCE)
    judged = [_judged(fine, _inside(transcription, x)) for x in candidates]
    x, defects, worst = min(judged, key=lambda entry: _rank(transcription, *entry))
    status = _weighed(status, worst <= 1.0)
    return Outcome(
        status=status,
        x=x,
        objective=float(x[transcription.layout.reference.final_mass]),
        violation=worst,
        defects=defects,
        n_iterations=limits.iterations,
        n_evaluations=limits.evaluations,
        cpu_seconds=limits.cpu_used,
    )


def _weighed(status: ExitStatus, is_feasible: bool) -> ExitStatus:
    """Return what a status means for a point that turned out feasible, or not."""
    if not is_feasible:
        return ExitStatus.STALLED if status in _ENDED_WELL else status
    if status in _ENDED_WELL or status is ExitStatus.STOPPED:
        return status
    return ExitStatus.FEASIBLE_AT_DEADLINE if status is ExitStatus.TIMEOUT else ExitStatus.FEASIBLE_AT_LIMIT


def _within(transcription: Transcription, guess: Array | Guess) -> Array | Guess:
    x = _inside(transcription, checked_vector(transcription.layout, guess))
    return Guess(x, guess.states) if isinstance(guess, Guess) else x


def _inside(transcription: Transcription, x: Array) -> Array:
    # IPOPT relaxes bounds by 1e-8; a solution must hold them exactly.
    lower, upper = transcription.bounds
    return np.clip(x, lower, upper)


def _judged(transcription: Transcription, x: Array) -> tuple[Array, Array, float]:
    defects = transcription.defects(x).reshape(-1, 7)
    if violation(defects) > _WELL_CLOSED:
        x, defects = _close(transcription, x, defects)
    return x, defects, violation(defects)


def _close(transcription: Transcription, x: Array, defects: Array) -> tuple[Array, Array]:
    """Close small defects of the single-matchpoint form by minimum-norm Gauss-Newton steps, if they shrink.

    Dropping the nodes adds up the residual defects of all legs, amplified by what lies behind them.
    """
    lower, upper = transcription.bounds
    for _ in range(3):
        if not _WELL_CLOSED < violation(defects) < _TOO_FAR:
            break
        scaled = transcription.jacobian(x).toarray() * (upper - lower)
        if not np.all(np.isfinite(scaled)):
            break
        free = (x > lower) & (x < upper)
        step = np.zeros(len(x))
        step[free] = np.linalg.lstsq(scaled[:, free], -defects.ravel(), rcond=1e-12)[0]
        trial = np.clip(x + step * (upper - lower), lower, upper)
        trial_defects = transcription.defects(trial).reshape(-1, 7)
        if not violation(trial_defects) < violation(defects):
            break
        x, defects = trial, trial_defects
    return x, defects


def _rank(transcription: Transcription, x: Array, defects: Array, worst: float) -> tuple[float, float]:
    """Order points: feasible before infeasible, then by violation, then by final mass."""
    return (max(worst, 1.0), -float(x[transcription.layout.reference.final_mass]))


def _status(run: Run, limits: Limits) -> ExitStatus:
    if run.code != _USER_STOP:
        return _STATUS.get(run.code, ExitStatus.SOLVER_FAILURE)
    if limits.is_stopped:
        return ExitStatus.STOPPED
    if run.is_settled:
        return ExitStatus.ACCEPTABLE
    return ExitStatus.TIMEOUT if limits.is_late else ExitStatus.ITERATION_LIMIT
