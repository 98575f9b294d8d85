"""Settings of a search: guess and hop distributions, mappings of seeds, and the address of a hop.

Nothing here computes, so reading a specification does not import the numerics; `core.search.hopping` draws
from the distributions.

Hops: a step r is in units of the width of its component's bounds, its components independent and identically
distributed.  Every law is symmetric about zero and has one scale: r = width * (a step of width 1).
docs/method.md, section 7, eqs. S10 to S15.

Mappings: the text in specifications and records, and the concrete assignments that it denotes.
`reference` alone is the paper's default, `aligned(0,2)` names a source for each realization, and `all`
denotes many mappings at once.  docs/method.md, section 8.
"""

import itertools
import re
from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

from pydantic import ConfigDict, Field

from core.problem import Outage, Problem, problem_from

#: Laws of guesses: uniform in the box is the paper's; the other burns along the velocity at both ends.
GUESS_LAWS = ("uniform", "thrust-coast-thrust")

#: Least and greatest shape of a law.  Below the least, steps would overflow: (2^53)^(1/0.1) is still finite.
SHAPES = (0.1, 10.0)


@dataclass(frozen=True, slots=True)
class HopLaw:
    """A symmetric law of steps, with the parameters it has where none are given."""

    #: Width of the law [-].
    width: float
    #: Exponent of the tail [-]; None for a law that has none.
    shape: float | None = None


#: The laws by name, with widths from docs/method.md, section 7; the Pareto law's are EMTG's preset.
HOP_LAWS: dict[str, HopLaw] = {
    "uniform": HopLaw(0.1),
    "gaussian": HopLaw(0.05),
    "cauchy": HopLaw(1e-3),
    "pareto": HopLaw(2.52e-6, 1.0 / 1.4),
}

#: Learning rate of an adaptive width, and the success rate at which it is constant [-]; eq. S14.
LEARNING_RATE, SUCCESS_SHARE = 0.3, 0.05
#: Least and greatest reach of an adaptive law [-]; eq. S15.
REACHES = (1e-4, 0.5)


@dataclass(frozen=True, slots=True)
class HopSettings:
    """How a chain draws its starts and its hops; a number out of range raises ValueError.

    The names are those of a campaign's specification.  As part of a job it is data: its bounds are in the
    schema of the API.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    #: A name of `GUESS_LAWS`.
    guess_law: str = "uniform"
    #: A name of `HOP_LAWS`.
    hop_law: str = "uniform"
    #: Scale of the hop law [-], in widths of the bounds; None for the law's own.
    hop_width: Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)] | None = None
    #: Exponent of the law's tail [-]; None for the law's own, and for a law without one.
    hop_shape: Annotated[float, Field(ge=SHAPES[0], le=SHAPES[1], allow_inf_nan=False)] | None = None
    #: Whether the width follows the chain's own successes.
    adaptive: bool = False
    #: Probability that a hop redraws a time [-].
    time_hop_probability: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] = 0.0
    #: Consecutive failed hops before the chain restarts from a new draw [-].
    max_failures: Annotated[int, Field(ge=1)] = 5

    def __post_init__(self) -> None:
        for name, laws in (("guess_law", GUESS_LAWS), ("hop_law", HOP_LAWS)):
            if getattr(self, name) not in laws:
                raise ValueError(f"{name}: expected one of {', '.join(laws)}, got {getattr(self, name)!r}")
        if self.hop_width is not None and not 0.0 < self.hop_width <= 1.0:
            raise ValueError(f"hop_width: expected a number in (0, 1], got {self.hop_width}")
        if self.hop_shape is not None:
            self._check_shape(self.hop_shape)
        if not 0.0 <= self.time_hop_probability <= 1.0:
            raise ValueError(
                f"time_hop_probability: expected a number in [0, 1], got {self.time_hop_probability}"
            )
        if self.max_failures < 1:
            raise ValueError(f"max_failures: expected at least 1, got {self.max_failures}")
        low, high = self.width_range
        if self.adaptive and not low <= self.width <= high:
            raise ValueError(
                f"hop_width: expected a number in [{low:.2g}, {high:.2g}] for an adaptive "
                f"{self.hop_law} law, got {self.width:.3g}"
            )

    def _check_shape(self, shape: float) -> None:
        if HOP_LAWS[self.hop_law].shape is None:
            raise ValueError(f"hop_shape: expected none for a {self.hop_law} law, got {shape}")
        if not SHAPES[0] <= shape <= SHAPES[1]:
            raise ValueError(f"hop_shape: expected a number in [{SHAPES[0]:g}, {SHAPES[1]:g}], got {shape}")

    @property
    def width(self) -> float:
        """Scale of the hop law at the start of a chain [-]."""
        return HOP_LAWS[self.hop_law].width if self.hop_width is None else self.hop_width

    @property
    def shape(self) -> float | None:
        """Exponent of the hop law's tail [-], if it has one."""
        return HOP_LAWS[self.hop_law].shape if self.hop_shape is None else self.hop_shape

    @property
    def width_range(self) -> tuple[float, float]:
        """Least and greatest width of an adaptive law [-], eq. S15."""
        # The 99th percentile of a step describes a heavy tail better than its scale.
        reach = 1.0 if self.shape is None else 100.0 ** (1.0 / self.shape)
        return REACHES[0] / reach, REACHES[1] / reach

    def next_width(self, width: float, has_won: bool) -> float:
        """Return the width [-] after a hop: wider after a success, narrower after a failure, eq. S14."""
        # Imported here: reading a specification needs no arrays.
        import numpy as np

        low, high = self.width_range
        return float(min(max(width * np.exp(LEARNING_RATE * (has_won - SUCCESS_SHARE)), low), high))


class HopAddress(NamedTuple):
    """The address of one hop: integers only, no worker, attempt or time."""

    #: 0 for a hop job, 1 for a map job.
    kind: int
    #: Number of the search in its campaign, and of the case in its search.
    search: int
    case: int
    #: Number of the chain; for a map job the seed's solution hash read as an integer.
    chain: int
    #: Number of the hop in its chain.
    hop: int


#: The forms of a mapping by name.
MAPPINGS = ("reference", "aligned", "continued")

#: Most guesses that one text may give for a seed.
EXPANSION_LIMIT = 10_000

#: Sources other than a list of numbers.
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
    """Raise ValueError unless a text is a mapping, whatever the problems.

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
        _parse(mapping)


def expand_mapping(mapping: str, problem_from: Problem, problem_to: Problem) -> tuple[str, ...]:
    """Return the concrete mappings that a text denotes, each in its canonical form.

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
    """Raise ValueError with the reason if solutions of one problem cannot be seeds for the other.

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
    """Raise ValueError for equally many outages, unless those of P_k are longer than those of P_k'."""
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


def _parse(mapping: str) -> tuple[str, str | tuple[int, ...] | None]:
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
    form, sources = _parse(mapping)
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
    # Digits are compared first: the power itself may not fit into memory.
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


#: The mapping of a seed onto the same problem with more segments.
REFINED = "refined"


def refined_problem(problem: Problem, n_segments: int) -> Problem:
    """Return a problem on a finer mesh, with its outages at the same times.

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
    """Return an outage that begins at the same time after each segment was divided into `factor` [-]."""
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
