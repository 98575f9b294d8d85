"""Safe modes: frequency and duration of losses of thrust, and the coverage of them by a set of outages.

Input: Weibull distributions of the times between safe modes and until recovery, and an arc or a problem with
its decision vector.  Output: probabilities.  Safe modes form a renewal process that starts with the arc: the
times between them, the first one included, are independent and identically distributed.  The duration of the
outages themselves is neglected.  An arc ends with the last segment: afterwards the spacecraft coasts on the
target, and no thrust can be missed.  All times are in days; those of a trajectory are past departure.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import asinh, ceil, isfinite, pi
from typing import Literal, NamedTuple, get_args

import numpy as np
import scipy
from numpy.polynomial import Chebyshev
from numpy.typing import ArrayLike, NDArray

from core.problem import Problem
from core.transcription.layout import CONTROL, checked_vector, layout_of

__all__ = [
    "RECOVERIES",
    "SAFE_MODES",
    "CountDistribution",
    "Coverage",
    "Statement",
    "Weibull",
    "count_distribution",
    "coverage",
    "duration_cdf",
    "quoted_statements",
]


Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Weibull:
    """The law F(t) = 1 - exp(-(t/scale)^shape) of a time t > 0; docs/method.md, section 13 (R1)."""

    #: Scale: the time exceeded with probability 1/e [days].
    scale_days: float
    #: Below 1 the rate falls with time, at 1 it is constant: the exponential law [-].
    shape: float

    def __post_init__(self) -> None:
        for name, value in (("scale_days", self.scale_days), ("shape", self.shape)):
            if not (isfinite(value) and value > 0.0):
                raise ValueError(f"{name}: expected a positive finite number, got {value}")

    def hazard(self, days: ArrayLike) -> Array:
        """Return (t/scale)^shape [-], the cumulative hazard at times [days]; 0 before time 0."""
        return np.asarray((np.maximum(days, 0.0) / self.scale_days) ** self.shape)

    def cdf(self, days: ArrayLike) -> Array:
        """Return the probability [-] that a time is at most so long [days]."""
        return np.asarray(-np.expm1(-self.hazard(days)))

    def survival(self, days: ArrayLike) -> Array:
        """Return the probability [-] that a time is longer [days]."""
        return np.asarray(np.exp(-self.hazard(days)))

    def density(self, days: ArrayLike) -> Array:
        """Return the density [1/days] at positive times [days]."""
        hazard = self.hazard(days)
        return np.asarray(self.shape * hazard / np.asarray(days, dtype=float) * np.exp(-hazard))

    def quantile(self, probability: ArrayLike) -> Array:
        """Return the quantile [days] of a probability in [0, 1)."""
        asked = np.asarray(probability, dtype=float)
        if not np.all((asked >= 0.0) & (asked < 1.0)):
            raise ValueError(f"probability: expected 0 <= p < 1, got {asked}")
        return np.asarray(self.scale_days * (-np.log1p(-asked)) ** (1.0 / self.shape))

    def mean(self) -> float:
        """Return the mean [days]."""
        return float(self.scale_days * scipy.special.gamma(1.0 + 1.0 / self.shape))

    def median(self) -> float:
        """Return the median [days]."""
        return float(self.quantile(0.5))

    def sample(self, rng: np.random.Generator, size: int | tuple[int, ...] = ()) -> Array:
        """Return independent times [days] of the given shape, a single one by default."""
        return np.asarray(self.scale_days * rng.weibull(self.shape, size))


#: Time between safe modes, and duration of the outage that one causes.  The values are those of public code
#: (GitHub paul-witsberger/neat-mt) that cites Imken et al., IEEE Aerospace 2018, doi
#: 10.1109/AERO.2018.8396383; the source itself was not available.  0.62394 years are 227.89 d.
SAFE_MODES = Weibull(scale_days=227.89, shape=0.86737)
RECOVERIES = Weibull(scale_days=2.459, shape=1.144)


#: Which single safe modes an outage must cover: those that begin in a thrusting segment; those too that begin
#: on a coast and last into a thrusting segment; any on the arc.
Counted = Literal["thrusting", "lasting", "any"]

#: Throttle above which a segment counts as thrusting [-]; pictures draw the others as coasts.
THRUSTING = 0.02

# Of the integral over one segment, absolute [-].
_QUADRATURE = 1e-12


@dataclass(frozen=True, slots=True)
class Coverage:
    """Probabilities [-] of safe modes until the end of the last segment; the four add up to 1."""

    #: No safe mode begins.
    none: float
    #: Exactly one, and it misses no thrust, or an outage of the problem is at its segment and as long.
    one_covered: float
    #: Exactly one, and no outage of the problem covers it.
    one_uncovered: float
    #: Two or more: never covered, since each realization has one outage.
    several: float
    #: From departure to the end of the last segment [days].
    arc_days: float

    @property
    def covered(self) -> float:
        """Probability of no safe mode or a covered one [-]."""
        return self.none + self.one_covered

    @property
    def one(self) -> float:
        """Probability of exactly one safe mode [-]."""
        return self.one_covered + self.one_uncovered


def coverage(
    problem: Problem,
    x: Array,
    between: Weibull = SAFE_MODES,
    recovery: Weibull = RECOVERIES,
    throttle_threshold: float = THRUSTING,
    counted: Counted = "thrusting",
) -> Coverage:
    """Return the probabilities that the outages of a problem cover the safe modes of its reference.

    A safe mode inside segment n counts as the outage at n, which begins with the segment, and is covered if
    it lasts no longer than the longest outage at n.

    Parameters
    ----------
    problem : Problem
        P_k; with no outages, only what misses no thrust is covered.
    x : (n_variables,) array
        Its decision vector [days, -, rad, kg], of which the reference's times and throttles are used.
    between, recovery : Weibull
        Laws of the time between safe modes, to the first one from departure, and of durations [days].
    throttle_threshold : float
        A segment thrusts when its throttle is above this [-].
    counted : {"thrusting", "lasting", "any"}
        Which single safe modes need an outage, see `Counted`.

    Raises
    ------
    ValueError
        When x does not fit the problem, or an option is unknown or out of range.

    References
    ----------
    docs/method.md, "Coverage".
    """
    if counted not in get_args(Counted):
        raise ValueError(f"counted: expected one of {', '.join(get_args(Counted))}, got {counted!r}")
    if not 0.0 <= throttle_threshold < 1.0:
        raise ValueError(f"throttle_threshold: expected 0 <= threshold < 1, got {throttle_threshold}")
    allowed = [0.0] * problem.n_segments
    for outage in problem.outages:
        allowed[outage.segment - 1] = max(allowed[outage.segment - 1], outage.duration_days)
    spans = spans_of(problem, x, allowed, throttle_threshold, counted)
    return coverage_of(spans, [chances(span, spans[-1].stop, between, recovery) for span in spans], between)


class Span(NamedTuple):
    """A coast or segment; a safe mode in it is covered if over by `missed_from + allowed`, or so short."""

    start: float
    stop: float
    #: When the first thrust is missed, if that is later than the safe mode.
    missed_from: float
    #: How long the outage may last from there on; infinite where nothing is missed.
    allowed: float


def coverage_of(spans: Sequence[Span], single: Sequence[tuple[float, float]], between: Weibull) -> Coverage:
    """Return the sums of `chances` over spans [-]."""
    arc = spans[-1].stop
    none = float(between.survival(arc))
    one, one_covered = (sum(chance) for chance in zip(*single, strict=True))
    return Coverage(none, one_covered, one - one_covered, 1.0 - none - one, arc)


def spans_of(
    problem: Problem, x: Array, allowed_days: Sequence[float], threshold: float, counted: Counted
) -> list[Span]:
    """Return the initial coast and the segments of a reference, with the outages that each can take.

    Parameters
    ----------
    problem : Problem
        P_k.
    x : (n_variables,) array
        Its decision vector [days, -, rad, kg], of which the reference's times and throttles are used.
    allowed_days : (N,) sequence
        The longest tolerated outage that begins with each segment [days].
    threshold : float
        A segment thrusts when its throttle is above this [-].
    counted : {"thrusting", "lasting", "any"}
        Which single safe modes need an outage, see `Counted`.
    """
    own, n = layout_of(problem).reference, problem.n_segments
    vector = checked_vector(layout_of(problem), x)
    starts = vector[own.initial_coast] + vector[own.shooting_time] * np.arange(n + 1) / n
    edges = [0.0, *starts.tolist()]
    # Entry 0 is the initial coast, at which no outage can be.
    is_lit = [False, *(vector[own.controls][::CONTROL] > threshold).tolist()]
    allowed = [0.0, *allowed_days]
    return [
        Span(edges[i], edges[i + 1], *_outage_in_span(i, edges, is_lit, allowed, counted))
        for i in range(n + 1)
    ]


def _outage_in_span(
    i: int, edges: list[float], is_lit: list[bool], allowed: list[float], counted: Counted
) -> tuple[float, float]:
    if is_lit[i] or counted == "any":
        return edges[i], allowed[i]
    following = next((j for j in range(i, len(is_lit)) if is_lit[j]), None)
    if counted == "thrusting" or following is None:
        return edges[i], np.inf
    return edges[following], allowed[following]


def chances(span: Span, arc_days: float, between: Weibull, recovery: Weibull) -> tuple[float, float]:
    """Return the probabilities that the only safe mode begins in a span, and that it is covered as well.

    Parameters
    ----------
    span : Span
        A coast or segment.
    arc_days : float
        From departure to the end of the last segment [days].
    between, recovery : Weibull
        Laws of the time between safe modes, and of durations [days].
    """
    return _chance(span, arc_days, between, None), _chance(span, arc_days, between, recovery)


def _chance(span: Span, arc: float, between: Weibull, recovery: Weibull | None) -> float:
    """Return the probability that the only safe mode begins in a span, and with a recovery is covered."""

    def integrand(time: float) -> float:
        # The first safe mode is now and the second after the arc: docs/method.md, section 13 (R5).
        alone = between.density(time) * between.survival(arc - time)
        if recovery is not None:
            alone *= recovery.cdf(max(span.missed_from - time, 0.0) + span.allowed)
        return float(alone)

    if span.start == span.stop:
        return 0.0
    return float(scipy.integrate.quad(integrand, span.start, span.stop, epsabs=_QUADRATURE, epsrel=1e-10)[0])


#: Longest arc, in mean times between safe modes.
LONGEST_ARC = 50.0

# Two resolutions must agree to this [-], and the degrees of the polynomials tried.
_AGREEMENT = 1e-10
_DEGREES = (24, 48, 96, 192)
# A count less likely than this ends the sums over counts [-].
_TAIL = 1e-13


@dataclass(frozen=True, slots=True, eq=False)
class CountDistribution:
    """How many safe modes begin on an arc."""

    #: Length of the arc [days].
    arc_days: float
    #: (n_max + 1,) probability of exactly 0, 1, .., n_max [-].
    probabilities: Array
    #: Expected number, of any size [-].
    mean: float

    @property
    def at_most_one(self) -> float:
        """Probability of none or one [-]."""
        return float(self.probabilities[:2].sum())

    @property
    def at_least_one(self) -> float:
        """Probability of one or more [-]."""
        return float(1.0 - self.probabilities[0])

    @property
    def one_given_any(self) -> float:
        """Probability of exactly one given one or more [-]; NaN on an arc of zero length."""
        return float(self.probabilities[1]) / self.at_least_one if self.at_least_one > 0.0 else float("nan")


def count_distribution(arc_days: float, n_max: int = 6, between: Weibull = SAFE_MODES) -> CountDistribution:
    """Return the probabilities of 0 to n_max safe modes on an arc, right to about 1e-10.

    Parameters
    ----------
    arc_days : float
        Length of the arc, with which the process begins [days].
    n_max : int
        Largest count asked for, at least 1 [-].
    between : Weibull
        Law of the times between safe modes, and of the time to the first [days].

    Raises
    ------
    ValueError
        When the arc is negative or longer than `LONGEST_ARC`, or n_max is below 1.

    References
    ----------
    docs/method.md, "Renewal counts".
    """
    longest = LONGEST_ARC * between.mean()
    if not 0.0 <= arc_days <= longest:
        raise ValueError(f"arc_days: expected 0 .. {longest:g} ({LONGEST_ARC:g} mean times), got {arc_days}")
    if n_max < 1:
        raise ValueError(f"n_max: expected at least 1, got {n_max}")
    # Rounding may leave an impossible count at -1e-16.
    counts = np.maximum(_counts(arc_days, n_max, between), 0.0)
    mean = float(np.arange(len(counts)) @ counts)
    return CountDistribution(arc_days, counts[: n_max + 1], mean)


def _counts(arc_days: float, n_max: int, between: Weibull) -> Array:
    """Return P(0), P(1), .. until negligible, at the lowest degree that agrees with half of it."""
    if arc_days == 0.0:
        return np.append(1.0, np.zeros(n_max))
    coarse = _counts_at(arc_days, n_max, between, _DEGREES[0])
    for degree in _DEGREES[1:]:
        fine = _counts_at(arc_days, n_max, between, degree)
        n = min(len(coarse), len(fine))
        if np.max(np.abs(fine[:n] - coarse[:n])) < _AGREEMENT:
            return fine
        coarse = fine
    law = f"scale {between.scale_days:g} days and shape {between.shape:g}"
    raise ValueError(
        f"between: expected a law that degree {_DEGREES[-1]} resolves on {arc_days:g} days, got {law}"
    )


def _counts_at(arc_days: float, n_max: int, between: Weibull, degree: int) -> Array:
    convolve = _Convolution(between, ceil(between.shape), _double_exponential(2 * degree, between.shape))
    last = convolve.variable(np.array(arc_days))
    domain = [0.0, float(last)]
    chance: _Chance = convolve.none
    counts = [float(chance(last))]
    least = max(n_max, arc_days / between.mean())
    # Where the degree is too low, the probabilities may grow instead of converging.
    while (len(counts) <= least or counts[-1] > _TAIL) and abs(counts[-1]) < 2.0:
        chance = Chebyshev.interpolate(partial(convolve.next, chance), degree, domain=domain)
        counts.append(float(chance(last)))
    return np.array(counts)


_Chance = Callable[[Array], Array]


class _Convolution(NamedTuple):
    """P(n + 1) from P(n): docs/method.md, section 13 (R3).

    As a function of time, P(n) has a non-integer power at 0.  In the hazard h it is entire, and so it is in
    h^(1/p) with an integer p, which grows no faster than the time: hence polynomials in that variable.
    """

    between: Weibull
    root: int
    nodes: "_Nodes"

    def variable(self, days: Array) -> Array:
        return np.asarray(self.between.hazard(days) ** (1.0 / self.root))

    def none(self, variable: Array) -> Array:
        return np.asarray(np.exp(-(variable**self.root)))

    def next(self, chance: _Chance, variable: Array) -> Array:
        arc = self.between.scale_days * variable[:, None] ** (self.root / self.between.shape)
        first = self.between.density(arc * self.nodes.from_start)
        rest = chance(self.variable(arc * self.nodes.from_stop))
        return np.asarray((arc * first * rest) @ self.nodes.weights)


class _Nodes(NamedTuple):
    """Quadrature on (0, 1): distances from both ends, of which neither may round to 0, and weights."""

    from_start: Array
    from_stop: Array
    weights: Array


def _double_exponential(n: int, shape: float) -> _Nodes:
    """Return the tanh-sinh rule: exponentially accurate for t^(shape - 1) and (1 - t)^shape alike."""
    # At the last node the integrand has fallen to exp(-37) = 1e-16 of itself.
    reach = asinh(37.0 / (pi * min(shape, 1.0)))
    x, step = np.linspace(-reach, reach, n, retstep=True)
    from_start, from_stop = 1.0 / (1.0 + np.exp(-pi * np.sinh(x))), 1.0 / (1.0 + np.exp(pi * np.sinh(x)))
    return _Nodes(from_start, from_stop, step * pi * np.cosh(x) * from_start * from_stop)


def duration_cdf(days: ArrayLike, recovery: Weibull = RECOVERIES) -> Array:
    """Return the probability that an outage lasts at most so long.

    Parameters
    ----------
    days : (n,) array
        Durations [days].
    recovery : Weibull
        Law of the duration [days].

    Returns
    -------
    (n,) array
        Probabilities [-].
    """
    return recovery.cdf(days)


@dataclass(frozen=True, slots=True)
class Statement:
    """A probability, and the event in words."""

    sentence: str
    #: Computed from the laws [-].
    value: float
    #: The number in the paper, whose text describes another event; None where it gives none [-].
    paper: float | None


def quoted_statements(between: Weibull = SAFE_MODES, recovery: Weibull = RECOVERIES) -> tuple[Statement, ...]:
    """Return the probabilities behind the three numbers about outages in the paper.

    Parameters
    ----------
    between, recovery : Weibull
        Laws of the times between safe modes, and of the durations of outages [days].

    References
    ----------
    docs/method.md, "What the paper quotes".
    """
    short = count_distribution(98.0, between=between)
    long = count_distribution(276.0, between=between)
    return (
        Statement("At most one safe mode in 98 days, which includes none.", short.at_most_one, 0.90),
        Statement("No safe mode in 98 days.", float(short.probabilities[0]), None),
        Statement("Exactly one in 98 days, given one or more.", short.one_given_any, None),
        Statement("Exactly one safe mode in 276 days.", float(long.probabilities[1]), 0.33),
        Statement("At least one safe mode in 276 days.", long.at_least_one, None),
        Statement("An outage lasts at most 1.5 days.", float(duration_cdf(1.5, recovery)), 0.40),
    )
