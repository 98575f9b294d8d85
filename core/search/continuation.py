"""One map job: a seed mapped to a guess for P_k and solved, through shallower outages if need be."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from core.nlp import (
    ExitStatus,
    Limits,
    Outcome,
    SolveSettings,
    Stop,
    close_defects,
    limits_of,
    never,
    optimize,
    outcome_of,
    solve,
)
from core.problem import Problem
from core.search.mapping import map_seed, outage_profiles
from core.transcription import DEFAULT_LEGS, Transcription, transcribe

Array = NDArray[np.float64]

#: First step of the depth, its growth after success and shrinkage after failure, and the least step.
FIRST_STEP, GROW, SHRINK, LEAST_STEP = 1.0, 2.0, 0.3, 1e-3
#: Iterations that one step may take; measured steps that converge take 13-60.
STEP_ITERATIONS = 80


def solve_seed(
    problem_from: Problem,
    x: Array,
    problem_to: Problem,
    mapping: str = "continued",
    settings: SolveSettings | None = None,
    stop: Stop = never,
    n_legs: int = DEFAULT_LEGS,
) -> Outcome:
    """Map a seed to a guess for P_k and solve it.

    Parameters
    ----------
    problem_from : Problem
        Problem P_k' of the seed.
    x : (n_variables,) array
        The seed [days, rad, kg].
    problem_to : Problem
        Problem P_k, of the same family and with more outages.
    mapping : str
        A name of `core.search.MAPPINGS`; "continued" deepens the outages from none to full.
    settings : SolveSettings
        Limits of all the work together; the defaults if None.
    stop : callable
        Asked once per iteration; true ends the solve.
    n_legs : int
        Shooting legs of the reference [-].

    Returns
    -------
    Outcome
        For P_k with full outages, whatever the path to it.

    Raises
    ------
    ValueError
        When the mapping is unknown or the problems do not fit each other.

    References
    ----------
    docs/method.md, section 8.
    """
    target = transcribe(problem_to, n_legs)
    guess = map_seed(problem_from, x, problem_to, mapping)
    if mapping != "continued":
        return solve(target, guess, settings, stop)
    limits = limits_of(target, settings or SolveSettings(), stop)
    start = target.lift(guess)
    if not np.all(np.isfinite(start)):
        return outcome_of(target, [target.drop_nodes(start)], ExitStatus.NOT_FINITE, limits)
    seed = np.asarray(x, dtype=float)
    deepest, depth = _deepen(target, problem_from, seed, start, limits)
    outcome = optimize(target, deepest, limits)
    if depth < 1.0 and not outcome.is_feasible and outcome.status is not ExitStatus.STOPPED:
        return replace(outcome, status=ExitStatus.STALLED if not limits.is_over else outcome.status)
    return outcome


def _deepen(
    target: Transcription, problem_from: Problem, seed: Array, start: Array, limits: Limits
) -> tuple[Array, float]:
    """Return the deepest lifted vector whose defects could be closed, and its depth."""
    z, depth, step = start, 0.0, FIRST_STEP
    while depth < 1.0 and step >= LEAST_STEP and not limits.is_over:
        trial = min(1.0, depth + step)
        profiles = outage_profiles(target.problem, problem_from, seed, trial)
        shallow = transcribe(target.problem, target.n_legs, target.tolerance, profiles)
        closed = close_defects(shallow, z, limits, STEP_ITERATIONS)
        if closed is None:
            step *= SHRINK
        else:
            z, depth, step = closed, trial, step * GROW
    return z, depth
