"""Mappings M: from a seed, a solution of P_k', to a guess for P_k.

`reference` is the paper's: a realization uses the remaining controls of the seed's reference, or of one of
its realizations.  `aligned` and `continued` are ours: the realization starts on the path of its source at the
same epochs, so that its only defect is the impulse of the missed segments. docs/method.md, section 8.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from core.problem import Outage, Problem
from core.search.alignment import Seed, aligned, refined_guess, thrust_profile
from core.search.settings import REFINED, assignment_of, default_sources
from core.transcription import (
    Guess,
    OutageProfile,
    TrajectoryLayout,
    Transcription,
    control_of,
    throttle_of,
    transcribe,
)

Array = NDArray[np.float64]


def map_seed(problem_from: Problem, x: Array, problem_to: Problem, mapping: str = "reference") -> Guess:
    """Return the guess for a problem that a seed gives.

    Parameters
    ----------
    problem_from : Problem
        Problem P_k' of the seed: the same family, with fewer or shorter outages, or P_k with fewer segments.
    x : (n_variables,) array
        The seed in the paper layout of P_k' [days, rad, kg].
    problem_to : Problem
        Problem P_k.
    mapping : str
        Text of one concrete mapping, see `core.search.expand_mapping`; "continued" starts
        where "aligned" does, and "refined" is the same trajectories on a finer mesh.

    Returns
    -------
    Guess
        In the paper layout of P_k, with states for the shooting nodes where the mapping is aligned.

    Raises
    ------
    ValueError
        When the text is not a mapping or denotes several, the problems are not a family with k' < k or with
        shorter outages, or x is no vector of P_k'.
    """
    if mapping == REFINED:
        return refined_guess(problem_from, x, problem_to)
    assignment = assignment_of(mapping, problem_from, problem_to)
    seed, target = Seed(problem_from, x), transcribe(problem_to)
    realizations = zip(target.layout.trajectories[1:], assignment.sources, strict=True)
    if assignment.form == "reference":
        parts = [_resume(target, own, seed, source) for own, source in realizations]
        return Guess(np.concatenate([seed.part(0), *parts]))
    laid = [aligned(target, own, seed, source) for own, source in realizations]
    states = (seed.reference.boundaries, *(path for _, path in laid))
    return Guess(np.concatenate([seed.part(0), *(part for part, _ in laid)]), states)


def outage_profiles(
    problem_to: Problem,
    problem_from: Problem,
    x: Array,
    depth: float,
    sources: Mapping[Outage, int] | None = None,
) -> tuple[OutageProfile, ...]:
    """Return the thrust that remains during the outages at a depth between 0 and 1.

    Parameters
    ----------
    problem_to, problem_from : Problem
        P_k, or what is left of it without some of its outages, and P_k' of the seed.
    x : (n_variables,) array
        The seed [days, rad, kg].
    depth : float
        0 keeps the thrust of the seed's path, 1 removes it [-].
    sources : mapping
        From each outage to the number of the seed's realization whose path it is, 0 for the reference; None:
        the defaults of "continued".

    References
    ----------
    docs/method.md, section 8: outage-depth continuation.
    """
    seed = Seed(problem_from, x)
    if sources is None:
        defaults = default_sources("continued", problem_from, problem_to)
        sources = dict(zip(problem_to.outages, defaults, strict=True))
    return tuple(thrust_profile(seed, outage, sources[outage], 1.0 - depth) for outage in problem_to.outages)


def onto_realizations(transcription: Transcription, reference: Array) -> Array:
    """Return x of a reference (3N + 4,) and, as realizations, its controls after the missed segments."""
    first, *others = transcription.layout.trajectories
    parts = [_shorten(transcription, own, reference, first) for own in others]
    return np.concatenate([reference, *parts])


def _resume(target: Transcription, own: TrajectoryLayout, seed: Seed, source: int) -> Array:
    """Return the variables of a realization that uses the remaining controls of its source."""
    old, part = seed.layout.trajectories[source], seed.part(source)
    x = _shorten(target, own, part, old)
    assert own.outage is not None
    if old.outage is not None and old.outage.segment == own.outage.segment:
        coast = part[1] - (own.outage.duration_days - old.outage.duration_days)
        x[1] = np.clip(coast, *_bounds(target, own.initial_coast))
    return x


def _shorten(target: Transcription, own: TrajectoryLayout, part: Array, old: TrajectoryLayout) -> Array:
    """Return a realization's variables: the last fraction of a trajectory's time and controls."""
    assert own.outage is not None
    n_segments = target.problem.n_segments
    left = n_segments - own.outage.segment
    right = n_segments - (old.outage.segment if old.outage else 0)
    controls = part[3:-1].reshape(-1, 3)
    left = min(left, right)
    shooting = np.clip(left / right * part[0], *_bounds(target, own.shooting_time))
    times = [shooting, target.bounds[0][own.initial_coast], part[2]]
    return np.concatenate([times, _last(controls, left, right, own.n_segments).ravel(), part[-1:]])


def _bounds(target: Transcription, index: int) -> tuple[float, float]:
    lower, upper = target.bounds
    return float(lower[index]), float(upper[index])


def _last(controls: Array, left: int, right: int, n: int) -> Array:
    """Return n controls with the mean thrust vectors of the last left/right of the time of others."""
    if left * len(controls) == n * right:
        return controls[len(controls) - n :]
    edges = np.arange(len(controls) + 1) / len(controls)
    wanted = 1.0 - left / right * (1.0 - np.arange(n + 1) / n)
    integral = np.vstack([np.zeros(3), np.cumsum(throttle_of(controls), axis=0)]) / len(controls)
    sums = np.stack([np.interp(wanted, edges, integral[:, i]) for i in range(3)], axis=1)
    return control_of(np.diff(sums, axis=0) * n * right / left)
