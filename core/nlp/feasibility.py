"""Feasibility of a decision vector: defects closed and checked with a finer integration tolerance."""

import numpy as np
from numpy.typing import NDArray

from core.nlp.outcome import ExitStatus, Limits, Outcome
from core.tolerances import violation
from core.transcription import FINE_TOLERANCE, Transcription

Array = NDArray[np.float64]

# The verifier uses another integrator and must agree, so defects are closed well below the tolerance.
_WELL_CLOSED, _TOO_FAR = 0.01, 1e4
_MOST_STEPS, _DOUBT = 3, 10.0
_ENDED_WELL = (ExitStatus.OPTIMAL, ExitStatus.ACCEPTABLE)


def outcome_of(transcription: Transcription, x: Array, status: ExitStatus, limits: Limits) -> Outcome:
    """Return the outcome of a decision vector inside its box, by its physical defects."""
    defects, worst = _defects_and_violation(transcription, x)
    if worst <= 1.0 and not transcription.is_clear(x):
        status, worst = ExitStatus.IMPACT, np.inf
    return Outcome(
        status=_reconcile(status, worst <= 1.0),
        x=x,
        objective=float(x[transcription.layout.reference.final_mass]),
        violation=worst,
        defects=defects,
        n_iterations=limits.iterations,
        n_evaluations=limits.evaluations,
        cpu_seconds=limits.cpu_used,
    )


def close_finely(transcription: Transcription, x: Array) -> Array:
    """Close small defects of the single-matchpoint form by minimum-norm Gauss-Newton steps, if they shrink.

    Dropping the nodes adds up the residual defects of all legs, amplified by what lies behind them.
    """
    fine, strict = transcription.at_tolerance(FINE_TOLERANCE), transcription.world.strict
    lower, upper = transcription.bounds
    defects = fine.defects(x)
    for _ in range(_MOST_STEPS):
        if not _WELL_CLOSED < violation(defects.reshape(-1, 7), strict) < _TOO_FAR:
            break
        scaled = fine.jacobian(x).toarray() * (upper - lower)
        if not np.all(np.isfinite(scaled)):
            break
        free = (x > lower) & (x < upper)
        step = np.zeros(len(x))
        try:
            step[free] = np.linalg.lstsq(scaled[:, free], -defects, rcond=1e-12)[0]
        except np.linalg.LinAlgError:
            break
        trial = np.clip(x + step * (upper - lower), lower, upper)
        trial_defects = fine.defects(trial)
        if not violation(trial_defects.reshape(-1, 7), strict) < violation(defects.reshape(-1, 7), strict):
            break
        x, defects = trial, trial_defects
    return x


def is_feasible(transcription: Transcription, x: Array, first: int = 0) -> bool:
    """Return whether a decision vector is closed to strict tolerance and passes through no body.

    Defects of trajectories before `first` are not checked: 0 is the reference.
    """
    return _defects_and_violation(transcription, x, first)[1] <= 1.0 and transcription.is_clear(x)


def _defects_and_violation(transcription: Transcription, x: Array, first: int = 0) -> tuple[Array, float]:
    """Return the defects [km, km/s, kg] and their violation, or its uncertainty if that is greater.

    The uncertainty is ten times the change caused by a ten times larger integration tolerance: on the most
    sensitive paths another integrator finds other defects, and closing them with this one gives no solution.
    """
    fine, coarse = (
        transcription.at_tolerance(tolerance).defects(x).reshape(-1, 7)
        for tolerance in (FINE_TOLERANCE, _DOUBT * FINE_TOLERANCE)
    )
    strict = transcription.world.strict
    return fine, max(violation(fine[first:], strict), _DOUBT * violation((fine - coarse)[first:], strict))


def _reconcile(status: ExitStatus, is_closed: bool) -> ExitStatus:
    """Return the status of a point, given that it is closed or not."""
    if not is_closed:
        return ExitStatus.STALLED if status in _ENDED_WELL else status
    if status in _ENDED_WELL or status is ExitStatus.STOPPED:
        return status
    return ExitStatus.FEASIBLE_AT_DEADLINE if status is ExitStatus.TIMEOUT else ExitStatus.FEASIBLE_AT_LIMIT
