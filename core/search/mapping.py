"""Mappings M: from a seed, a solution of P_k', to a guess for P_k.

`reference` is the paper's: a realization uses the remaining controls of the seed's reference, or of one of
its realizations.  `aligned` and `continued` are ours: the realization starts on the path of its source at the
same epochs, so that its only defect is the impulse of the missed segments. docs/method.md, section 8.
"""

from collections.abc import Mapping
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from core.nlp.recoveries import SAME, rejoin
from core.problem import Outage, Problem
from core.search.settings import REFINED, assignment_of, check_refinement, default_sources
from core.transcription import (
    FlownPath,
    Guess,
    OutageProfile,
    RealizationPath,
    ReferencePath,
    TrajectoryLayout,
    Transcription,
    checked_vector,
    control_of,
    layout_of,
    throttle_of,
    transcribe,
)

Array = NDArray[np.float64]


class Seed:
    """A solution of P_k' and its propagated paths.

    Parameters
    ----------
    problem : Problem
        P_k'.
    x : (n_variables,) array
        The solution [days, rad, kg].

    Raises
    ------
    ValueError
        When x is no vector of P_k'.
    """

    def __init__(self, problem: Problem, x: Array) -> None:
        self.transcription = transcribe(problem)
        self.layout = self.transcription.layout
        self.x = checked_vector(self.layout, x)
        self._paths: dict[int, FlownPath] = {}

    @cached_property
    def reference(self) -> ReferencePath:
        """The path without an outage."""
        return ReferencePath(self.transcription, self.x)

    def path(self, source: int) -> FlownPath:
        """Return the path of a realization, counted from 1, or for 0 of the reference."""
        if source == 0:
            return self.reference
        if source not in self._paths:
            self._paths[source] = RealizationPath(self.transcription, self.x, source)
        return self._paths[source]

    def part(self, source: int) -> Array:
        """Return the variables of a trajectory [days, rad, kg]."""
        trajectory = self.layout.trajectories[source]
        return self.x[trajectory.offset : trajectory.stop]


def aligned(
    target: Transcription, trajectory: TrajectoryLayout, seed: Seed, source: int
) -> tuple[Array, Array]:
    """Return a realization that rejoins a path of the seed at the first edge after its outage.

    Parameters
    ----------
    target : Transcription
        P_k.
    trajectory : TrajectoryLayout
        Where the realization stands in it.
    seed : Seed
        The seed.
    source : int
        The path: 0 for the reference, or the number of a realization [-].

    Returns
    -------
    (n,) array, (N_w + 1, 7) array
        Its variables [days, rad, kg] and the path at its segment boundaries [LU, VU, MU].

    References
    ----------
    docs/method.md, eqs. S4 and S24.
    """
    path, old = seed.path(source), seed.layout.trajectories[source]
    if old.outage == trajectory.outage:
        return seed.part(source), path.boundaries
    assert trajectory.outage is not None
    rest = (float(seed.x[old.final_coast]), float(seed.x[old.final_mass]))
    return rejoin(target, trajectory, path, _end(seed, trajectory.outage), rest)


def thrust_profile(seed: Seed, outage: Outage, source: int, share: float) -> OutageProfile:
    """Return the thrust profile of a path of the seed during an outage, scaled by a fraction.

    Parameters
    ----------
    seed : Seed
        The seed.
    outage : Outage
        The outage.
    source : int
        The path: 0 for the reference, or the number of a realization [-].
    share : float
        Between 0 and 1 [-].

    References
    ----------
    docs/method.md, eq. S5.
    """
    path, begin = seed.path(source), seed.reference.boundary_time(outage.segment)
    slack, end = SAME * path.segment_time, _end(seed, outage)
    # The solver could shrink an arc that began after the end to zero or negative length.
    inside = [edge for edge in path.edges if begin + slack < edge < end - slack]
    held = []
    for start, stop in pairwise([begin, *inside, end]):
        throttle, *angles = (float(number) for number in path.control(0.5 * (start + stop)))
        held.append((stop - start, (share * throttle, angles[0], angles[1])))
    return tuple(held)


def _end(seed: Seed, outage: Outage) -> float:
    """Return when an outage ends [TU past departure]."""
    return seed.reference.boundary_time(outage.segment) + outage.duration_days / seed.reference.tu_days


def refined_guess(problem_from: Problem, x: Array, problem_to: Problem) -> Guess:
    """Return the trajectories of a seed as a guess for the same problem on a finer mesh.

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
    return Guess(
        np.concatenate([_subdivide(seed[old.offset : old.stop], old, new, factor) for old, new in pairs])
    )


def _subdivide(part: Array, old: TrajectoryLayout, new: TrajectoryLayout, factor: int) -> Array:
    """Return the variables of a trajectory with each segment divided into `factor`, and unlit ones added."""
    shooting, initial, final = part[:3]
    h = shooting / (factor * old.n_segments)
    extra = new.n_segments - factor * old.n_segments
    before = min(extra, int(initial / h + SAME)) if h > 0.0 else extra
    after = extra - before
    controls = np.repeat(part[3:-1].reshape(-1, 3), factor, axis=0)
    unlit = np.zeros((extra, 3))
    times = [shooting + extra * h, max(initial - before * h, 0.0), max(final - after * h, 0.0)]
    return np.concatenate([times, np.vstack([unlit[:before], controls, unlit[before:]]).ravel(), part[-1:]])


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
