"""Mappings M: from a seed, a solution of P_k', to a guess for P_k.

`reference` is the paper's: a realization flies the controls that the seed's reference, or one of its
realizations, has left.  `aligned` and `continued` are ours: the realization starts on the path of its source
at the same epochs, so that all its defects vanish but the impulse of the missed segments.
docs/method.md, section 8.

What a mapping is called: its form, and where each realization of P_k comes from.

Text goes in, as users write it and records keep it; concrete assignments come out.  `reference` alone is the
paper's default, `aligned(0,2)` names a source per realization, and `all` stands for many mappings at once.
docs/method.md, section 8.
"""

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.problem import Outage, Problem
from core.search.alignment import REFINED, Seed, aligned, check_refinement, held_thrust, refined_guess
from core.transcription import (
    Guess,
    OutageProfile,
    TrajectoryLayout,
    Transcription,
    control_of,
    throttle_of,
    transcribe,
)

__all__ = ["MAPPINGS", "map_seed", "onto_realizations", "outage_profiles"]


#: The forms of a mapping by name.
MAPPINGS = ("reference", "aligned", "continued")

#: The most guesses that one text may make of a seed.
EXPANSION_LIMIT = 10_000

#: Sources that are no list of numbers.
_EVERY, _NEAREST = "all", "nearest"

_NUMBER = "(?:0|[1-9][0-9]{0,3})"
_SYNTAX = re.compile(rf"({'|'.join(MAPPINGS)})(?:\(({_EVERY}|{_NEAREST}|{_NUMBER}(?:, ?{_NUMBER})*)\))?")


@dataclass(frozen=True, slots=True)
class Assignment:
    """One concrete mapping from P_k' to P_k."""

    #: A name of `MAPPINGS`.
    form: str
    #: (k,) where each realization comes from: 0 is the seed's reference, i its i-th realization.
    sources: tuple[int, ...]


def check_mapping(mapping: str) -> None:
    """Refuse a text that is no mapping, whatever the problems.

    Parameters
    ----------
    mapping : str
        FORM, FORM(SOURCES), "all", "nearest" or "refined": a form is one of `MAPPINGS`, sources are all,
        nearest or one number per realization, separated by commas.

    Raises
    ------
    ValueError
        When it is none of these.
    """
    if mapping != REFINED:
        _parsed(mapping)


def expand_mapping(mapping: str, problem_from: Problem, problem_to: Problem) -> tuple[str, ...]:
    """Return the concrete mappings that a text stands for, each in the one way in which it is written.

    Parameters
    ----------
    mapping : str
        As for `check_mapping`.
    problem_from, problem_to : Problem
        P_k' of the seeds, and P_k.

    Returns
    -------
    tuple of str
        A form alone where the sources are those that it has by default, else with its sources: `reference`,
        `aligned(1,2)`.  For "all" the seed's reference everywhere comes first, then the k'^k assignments.

    Raises
    ------
    ValueError
        When the text is no mapping, its sources do not fit the problems, there are too many, or the problems
        are no family from P_k' to P_k.

    References
    ----------
    docs/method.md, eq. S20.
    """
    if mapping == REFINED:
        check_refinement(problem_from, problem_to)
        return (REFINED,)
    found = _assignments(mapping, problem_from, problem_to)
    return tuple(_text(assignment, problem_from, problem_to) for assignment in found)


def assignment_of(mapping: str, problem_from: Problem, problem_to: Problem) -> Assignment:
    """Return the one concrete mapping that a text stands for, or raise ValueError naming how many it does."""
    found = _assignments(mapping, problem_from, problem_to)
    if len(found) != 1:
        raise ValueError(
            f"mapping: expected one that makes one guess, got {mapping!r}, which makes {len(found)} from "
            f"k' = {problem_from.k} to k = {problem_to.k}; expand it first"
        )
    return found[0]


def default_sources(form: str, problem_from: Problem, problem_to: Problem) -> tuple[int, ...]:
    """Return the sources (k,) of a form that names none.

    With as many outages in P_k' each realization comes from its own; else all come from the seed's reference,
    but `aligned` and `continued` keep realizations whose outage the seed survives already.
    """
    if problem_from.k == problem_to.k:
        return tuple(range(1, problem_to.k + 1))
    if form == "reference":
        return (0,) * problem_to.k
    known = {outage: number for number, outage in enumerate(problem_from.outages, start=1)}
    return tuple(known.get(outage, 0) for outage in problem_to.outages)


def check_family(problem_from: Problem, problem_to: Problem) -> None:
    """Refuse problems of which one gives no seeds for the other, with the reason.

    P_k' has the same reference problem as P_k, and fewer outages; or as many in the same segments, of which
    none is longer and one is shorter.
    """
    if problem_from.family != problem_to.family:
        raise ValueError(
            "seed: expected a problem that differs in its outages alone, got another reference problem"
        )
    if problem_from.k > problem_to.k:
        raise ValueError(f"seed: expected at most {problem_to.k} outages, got {problem_from.k}")
    if problem_from.k == problem_to.k:
        _check_deepening(problem_from, problem_to)


def _check_deepening(problem_from: Problem, problem_to: Problem) -> None:
    """Refuse problems with as many outages, unless those of P_k outlast those of P_k'."""
    if problem_from.outages == problem_to.outages:
        raise ValueError(f"seed: expected fewer or shorter outages, got the very same {problem_from.k}")
    segments, wanted = ([o.segment for o in problem.outages] for problem in (problem_from, problem_to))
    if segments != wanted:
        raise ValueError(
            f"seed: expected fewer outages, or as many in the same segments {wanted}, got {segments}"
        )
    for old, new in zip(problem_from.outages, problem_to.outages, strict=True):
        if old.duration_days > new.duration_days:
            raise ValueError(
                f"seed: expected an outage of at most {new.duration_days} days in segment {new.segment}, got "
                f"{old.duration_days}"
            )


def _parsed(mapping: str) -> tuple[str, str | tuple[int, ...] | None]:
    """Return form and sources of a text; None where it names no sources."""
    if mapping in (_EVERY, _NEAREST):
        return MAPPINGS[0], mapping
    match = _SYNTAX.fullmatch(mapping)
    if match is None:
        raise ValueError(
            f"mapping: expected all, nearest or one of {', '.join(MAPPINGS)}, alone or with sources as in "
            f"aligned(all), aligned(nearest) or aligned(0,2), got {mapping!r}"
        )
    form, sources = match.groups()
    if sources is None or sources in (_EVERY, _NEAREST):
        return form, sources
    return form, tuple(int(number) for number in sources.split(","))


def _assignments(mapping: str, problem_from: Problem, problem_to: Problem) -> list[Assignment]:
    form, sources = _parsed(mapping)
    check_family(problem_from, problem_to)
    if sources is None:
        found = [default_sources(form, problem_from, problem_to)]
    elif sources == _EVERY:
        found = _all_sources(mapping, problem_from.k, problem_to.k)
    elif sources == _NEAREST:
        found = [tuple(_nearest(problem_from, outage) for outage in problem_to.outages)]
    else:
        assert not isinstance(sources, str)
        _check_sources(mapping, sources, problem_from, problem_to)
        found = [sources]
    return [Assignment(form, one) for one in found]


def _all_sources(mapping: str, k_from: int, k: int) -> list[tuple[int, ...]]:
    """Return the seed's reference for all, then every choice among its realizations, eq. S20."""
    # Compared by digits first: the power itself may not fit into memory.
    if k_from > 1 and (k > EXPANSION_LIMIT.bit_length() or k_from**k + 1 > EXPANSION_LIMIT):
        raise ValueError(
            f"mapping: expected at most {EXPANSION_LIMIT} guesses of a seed, got {mapping!r}, which makes "
            f"{k_from}^{k} + 1; name the sources"
        )
    return [(0,) * k, *itertools.product(range(1, k_from + 1), repeat=k)]


def _nearest(problem_from: Problem, outage: Outage) -> int:
    """Return the seed's realization of the closest outage, 0 if it has none; of two the earlier."""
    numbers = range(1, problem_from.k + 1)
    return min(numbers, key=lambda i: abs(problem_from.outages[i - 1].segment - outage.segment), default=0)


def _check_sources(
    mapping: str, sources: tuple[int, ...], problem_from: Problem, problem_to: Problem
) -> None:
    if len(sources) != problem_to.k:
        raise ValueError(
            f"mapping: expected {problem_to.k} sources, one per outage, got {len(sources)} in {mapping!r}"
        )
    if max(sources) > problem_from.k:
        raise ValueError(
            f"mapping: expected sources in 0..{problem_from.k}, the seed's realizations, got "
            f"{max(sources)} in {mapping!r}"
        )


def _text(assignment: Assignment, problem_from: Problem, problem_to: Problem) -> str:
    if assignment.sources == default_sources(assignment.form, problem_from, problem_to):
        return assignment.form
    return f"{assignment.form}({','.join(map(str, assignment.sources))})"


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
        A text that stands for one concrete mapping, see `core.search.expand_mapping`; "continued" starts
        where "aligned" does, and "refined" is the same flight in more segments.

    Returns
    -------
    Guess
        In the paper layout of P_k, with states for the shooting nodes where the mapping is aligned.

    Raises
    ------
    ValueError
        When the text is no mapping or stands for several, the problems are not a family with k' < k or with
        shorter outages, or x is no vector of P_k'.
    """
    if mapping == REFINED:
        return refined_guess(problem_from, x, problem_to)
    assignment = assignment_of(mapping, problem_from, problem_to)
    seed, target = Seed(problem_from, x), transcribe(problem_to)
    realizations = zip(target.layout.trajectories[1:], assignment.sources, strict=True)
    if assignment.form == "reference":
        parts = [_resumed(target, own, seed, source) for own, source in realizations]
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
    """Return what is still flown during the outages at a depth of them between 0 and 1.

    Parameters
    ----------
    problem_to, problem_from : Problem
        P_k, or what is left of it without some of its outages, and P_k' of the seed.
    x : (n_variables,) array
        The seed [days, rad, kg].
    depth : float
        At 0 the thrust of the seed's path holds on; at 1 there is none [-].
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
    return tuple(held_thrust(seed, outage, sources[outage], 1.0 - depth) for outage in problem_to.outages)


def onto_realizations(transcription: Transcription, reference: Array) -> Array:
    """Return x of a reference (3N + 4,) and, as realizations, its controls after the missed segments."""
    first, *others = transcription.layout.trajectories
    parts = [_shortened(transcription, own, reference, first) for own in others]
    return np.concatenate([reference, *parts])


def _resumed(target: Transcription, own: TrajectoryLayout, seed: Seed, source: int) -> Array:
    """Return the variables of a realization that flies what its source has left of its controls."""
    old, part = seed.layout.trajectories[source], seed.part(source)
    x = _shortened(target, own, part, old)
    assert own.outage is not None
    if old.outage is not None and old.outage.segment == own.outage.segment:
        coast = part[1] - (own.outage.duration_days - old.outage.duration_days)
        x[1] = np.clip(coast, *_bounds(target, own.initial_coast))
    return x


def _shortened(target: Transcription, own: TrajectoryLayout, part: Array, old: TrajectoryLayout) -> Array:
    """Return a realization's variables: the last share of a trajectory's time and controls."""
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
