"""A seed cut finer: the same flight in a multiple of its segments, as a guess for a problem of its own.

Nothing is lost: each control is repeated, so the thrust is the same function of time, and what follows is
the solver's gain alone.  docs/method.md, eqs. S26 and S27.
"""

import numpy as np
from numpy.typing import NDArray

from core.problem import Outage, Problem, problem_from
from core.search.alignment import SAME
from core.transcription import Guess, TrajectoryLayout, checked_vector, layout_of

Array = NDArray[np.float64]

#: What the mapping is called.
REFINED = "refined"


def refined_problem(problem: Problem, n_segments: int) -> Problem:
    """Return a problem with more segments, its outages at the same times.

    Parameters
    ----------
    problem : Problem
        P_k.
    n_segments : int
        Segments of the reference [-], a multiple of those that it has.

    Raises
    ------
    ValueError
        When it is no multiple, or one of 1.
    """
    factor, rest = divmod(n_segments, problem.n_segments)
    if rest or factor < 2:
        raise ValueError(
            f"segments: expected a multiple of {problem.n_segments} and more than that, got {n_segments}"
        )
    outages = [refined_outage(factor, outage).model_dump() for outage in problem.outages]
    return problem_from(problem.model_dump(mode="json") | {"n_segments": n_segments, "outages": outages})


def refined_outage(factor: int, outage: Outage) -> Outage:
    """Return an outage that begins at the same time where each segment was cut in `factor` [-]."""
    return Outage(segment=factor * (outage.segment - 1) + 1, duration_days=outage.duration_days)


def check_refinement(problem_from: Problem, problem_to: Problem) -> int:
    """Return how many segments of P_k a segment of the seed's problem becomes, or raise ValueError."""
    finer = refined_problem(problem_from, problem_to.n_segments)
    if finer.hash != problem_to.hash:
        raise ValueError(
            "seed: expected a problem that differs in its number of segments alone, its outages at the same "
            "times, got another one"
        )
    return problem_to.n_segments // problem_from.n_segments


def refined_guess(problem_from: Problem, x: Array, problem_to: Problem) -> Guess:
    """Return the flight of a seed as a guess for the same problem with more segments.

    A realization of N - n segments becomes one of m (N - n) + m - 1, since the segment that an outage misses
    is shorter too.  The m - 1 extra segments stay unlit: they lie in the initial coast as far as that is
    long enough, and else in the final one, on a ballistic target without an effect.

    Parameters
    ----------
    problem_from : Problem
        Problem of the seed.
    x : (n_variables,) array
        The seed [days, rad, kg].
    problem_to : Problem
        The same with m times the segments, see `refined_problem`.

    Returns
    -------
    Guess
        In the paper layout of `problem_to`.

    Raises
    ------
    ValueError
        When the problems differ otherwise, or x is no vector of the seed's problem.

    References
    ----------
    docs/method.md, eqs. S26 and S27.
    """
    factor = check_refinement(problem_from, problem_to)
    seed = checked_vector(layout_of(problem_from), x)
    pairs = zip(layout_of(problem_from).trajectories, layout_of(problem_to).trajectories, strict=True)
    return Guess(np.concatenate([_cut(seed[old.offset : old.stop], old, new, factor) for old, new in pairs]))


def _cut(part: Array, old: TrajectoryLayout, new: TrajectoryLayout, factor: int) -> Array:
    """Return the variables of a trajectory with each segment cut in `factor`, and unlit ones added."""
    shooting, initial, final = part[:3]
    h = shooting / (factor * old.n_segments)
    extra = new.n_segments - factor * old.n_segments
    before = min(extra, int(initial / h + SAME)) if h > 0.0 else extra
    after = extra - before
    controls = np.repeat(part[3:-1].reshape(-1, 3), factor, axis=0)
    unlit = np.zeros((extra, 3))
    times = [shooting + extra * h, max(initial - before * h, 0.0), max(final - after * h, 0.0)]
    return np.concatenate([times, np.vstack([unlit[:before], controls, unlit[before:]]).ravel(), part[-1:]])
