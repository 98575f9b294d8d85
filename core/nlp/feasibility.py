"""What a decision vector is worth: its defects closed and judged by a finer integrator."""

import numpy as np
from numpy.typing import NDArray

from core.nlp.outcome import ExitStatus, Limits, Outcome
from core.tolerances import violation
from core.transcription import FINE_TOLERANCE, Transcription

Array = NDArray[np.float64]

# Another integrator must agree that the point is feasible, so defects are closed well below the tolerance.
_WELL_CLOSED, _TOO_FAR = 0.01, 1e4
_MOST_STEPS, _DOUBT = 3, 10.0
_ENDED_WELL = (ExitStatus.OPTIMAL, ExitStatus.ACCEPTABLE)


def outcome_of(transcription: Transcription, x: Array, status: ExitStatus, limits: Limits) -> Outcome:
    """Return the outcome that a decision vector inside its box is, judged by its physical defects."""
    defects, worst = _judged(transcription, x)
    if worst <= 1.0 and not transcription.is_clear(x):
        status, worst = ExitStatus.IMPACT, np.inf
    return Outcome(
        status=_weighed(status, worst <= 1.0),
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
    fine = transcription.at_tolerance(FINE_TOLERANCE)
    lower, upper = transcription.bounds
    defects = fine.defects(x)
    for _ in range(_MOST_STEPS):
        if not _WELL_CLOSED < violation(defects.reshape(-1, 7)) < _TOO_FAR:
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
        if not violation(trial_defects.reshape(-1, 7)) < violation(defects.reshape(-1, 7)):
            break
        x, defects = trial, trial_defects
    return x


def is_feasible(transcription: Transcription, x: Array, first: int = 0) -> bool:
    """Return whether a decision vector is closed to strict tolerance and leads through no body.

    Trajectories before the first asked for are not judged by their defects: 0 is the reference.
    """
    return _judged(transcription, x, first)[1] <= 1.0 and transcription.is_clear(x)


def _judged(transcription: Transcription, x: Array, first: int = 0) -> tuple[Array, float]:
    """Return the defects [km, km/s, kg] and their violation, or the doubt about them if that is greater.

    The doubt is what ten times the integrator's tolerance changes, ten times: on the most sensitive paths
    another integrator finds other defects, and nothing that this one closes is a solution.
    """
    fine, coarse = (
        transcription.at_tolerance(tolerance).defects(x).reshape(-1, 7)
        for tolerance in (FINE_TOLERANCE, _DOUBT * FINE_TOLERANCE)
    )
    return fine, max(violation(fine[first:]), _DOUBT * violation((fine - coarse)[first:]))


def _weighed(status: ExitStatus, is_closed: bool) -> ExitStatus:
    """Return what a status means for a point that turned out closed, or not."""
    if not is_closed:
        return ExitStatus.STALLED if status in _ENDED_WELL else status
    if status in _ENDED_WELL or status is ExitStatus.STOPPED:
        return status
    return ExitStatus.FEASIBLE_AT_DEADLINE if status is ExitStatus.TIMEOUT else ExitStatus.FEASIBLE_AT_LIMIT
