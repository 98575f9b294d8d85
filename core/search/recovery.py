"""Recoveries from outages with a frozen reference, and continuation of seeds in the depth of the outages.

With a frozen reference each recovery is an independent transfer: it starts from the state of the reference
when thrust stops, coasts for at least the outage, and arrives with the greatest mass.  docs/missed-thrust.md.
"""

import numpy as np
from numpy.typing import NDArray

from core.nlp import ExitStatus, Outcome, SolveSettings, Stop, no_stop, solve
from core.nlp.feasibility import outcome_of
from core.nlp.outcome import Limits
from core.nlp.recoveries import recovery, to_realization, to_recovery
from core.problem import Problem
from core.search.mapping import map_seed, outage_profiles
from core.search.settings import REFINED, assignment_of
from core.transcription import (
    DEFAULT_LEGS,
    FINE_TOLERANCE,
    TOLERANCE,
    Guess,
    OutageProfile,
    ReferencePath,
    transcribe,
)

Array = NDArray[np.float64]


def solve_recovery(
    problem_from: Problem,
    x: Array,
    problem_to: Problem,
    mapping: str = "aligned",
    settings: SolveSettings | None = None,
    stop: Stop = no_stop,
    n_legs: int = DEFAULT_LEGS,
    tolerance: float = TOLERANCE,
) -> Outcome:
    """Freeze a seed's reference, and recover from each outage of P_k with the least propellant.

    Parameters
    ----------
    problem_from : Problem
        Problem P_k' of the seed.
    x : (n_variables,) array
        The seed [days, rad, kg].
    problem_to : Problem
        Problem P_k, of the same family and with more outages, or with longer ones.
    mapping : str
        Text of one concrete mapping, see `core.search.expand_mapping`: it gives the guess of each recovery.
    settings : SolveSettings
        Limits of each recovery; the defaults if None.
    stop : callable
        Asked once per iteration; true ends the solve.
    n_legs : int
        Shooting legs of the reference, recoveries in proportion [-].
    tolerance : float
        Of the integrator while propellant is saved, in canonical units [-].

    Returns
    -------
    Outcome
        For P_k: the reference is the seed's to the last bit, and so is the objective, its final mass.

    Raises
    ------
    ValueError
        When the mapping is unknown or denotes several, or the problems do not fit each other.

    References
    ----------
    docs/missed-thrust.md.
    """
    limits = Limits(np.inf, np.iinfo(np.int64).max, stop)
    guess, target = map_seed(problem_from, x, problem_to, mapping), transcribe(problem_to, n_legs, tolerance)
    states = guess.states or (None,) * len(target.layout.trajectories)
    path = ReferencePath(target.at_tolerance(FINE_TOLERANCE), guess.x)
    found, status = guess.x.copy(), ExitStatus.OPTIMAL
    for own, flown in zip(target.layout.trajectories[1:], states[1:], strict=True):
        part = recovery(target, path, own)
        start = to_recovery(own, guess.x[own.offset : own.stop])
        outcome = solve(part, Guess(start, (flown,)), settings, stop)
        found[own.offset : own.stop] = to_realization(target, own, outcome.x)
        limits.iterations += outcome.n_iterations
        limits.evaluations += outcome.n_evaluations
        status = status if outcome.status is ExitStatus.OPTIMAL else outcome.status
    return outcome_of(target, found, status, limits)


def solve_seed(
    problem_from: Problem,
    x: Array,
    problem_to: Problem,
    mapping: str = "continued",
    settings: SolveSettings | None = None,
    stop: Stop = no_stop,
    n_legs: int = DEFAULT_LEGS,
    tolerance: float = TOLERANCE,
) -> Outcome:
    """Map a seed to a guess for P_k and solve it.

    Parameters
    ----------
    problem_from : Problem
        Problem P_k' of the seed.
    x : (n_variables,) array
        The seed [days, rad, kg].
    problem_to : Problem
        Problem P_k, of the same family and with more outages, or with longer ones; or P_k' on a finer mesh.
    mapping : str
        Text of one concrete mapping, see `core.search.expand_mapping`; "continued" deepens the
        outages from none, or from the shorter ones of the seed, to full.
    settings : SolveSettings
        Limits of the whole solve; the defaults if None.
    stop : callable
        Asked once per iteration; true ends the solve.
    n_legs : int
        Shooting legs of the reference [-].
    tolerance : float
        Of the integrator while propellant is saved, in canonical units [-].

    Returns
    -------
    Outcome
        For P_k with full outages, whatever the path to it.

    Raises
    ------
    ValueError
        When the mapping is unknown or denotes several, or the problems do not fit each other.

    References
    ----------
    docs/method.md, section 8.
    """
    guess = map_seed(problem_from, x, problem_to, mapping)
    target = transcribe(problem_to, n_legs, tolerance)
    if mapping == REFINED:
        return solve(target, guess, settings, stop)
    assignment = assignment_of(mapping, problem_from, problem_to)
    sources = dict(zip(problem_to.outages, assignment.sources, strict=True))
    seed = np.asarray(x, dtype=float)

    def deepen(problem: Problem, depth: float) -> tuple[OutageProfile, ...]:
        return outage_profiles(problem, problem_from, seed, depth, sources)

    return solve(target, guess, settings, stop, deepen if assignment.form == "continued" else None)
