"""One map job: a seed mapped to a guess for P_k and solved, through shallower outages if need be."""

import numpy as np
from numpy.typing import NDArray

from core.nlp import Outcome, SolveSettings, Stop, never, solve
from core.problem import Problem
from core.search.assignments import assignment_of
from core.search.mapping import map_seed, outage_profiles
from core.search.refinement import REFINED
from core.transcription import DEFAULT_LEGS, TOLERANCE, OutageProfile, transcribe

Array = NDArray[np.float64]


def solve_seed(
    problem_from: Problem,
    x: Array,
    problem_to: Problem,
    mapping: str = "continued",
    settings: SolveSettings | None = None,
    stop: Stop = never,
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
        Problem P_k, of the same family and with more outages, or with longer ones; or P_k' in more segments.
    mapping : str
        A text that stands for one concrete mapping, see `core.search.expand_mapping`; "continued" deepens the
        outages from none, or from the shorter ones of the seed, to full.
    settings : SolveSettings
        Limits of all the work together; the defaults if None.
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
        When the mapping is unknown or stands for several, or the problems do not fit each other.

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
