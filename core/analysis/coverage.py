"""How much of what may happen on a trajectory a set of outages covers.

What flows in: a problem, its decision vector and the two laws of outages.  What flows out: the probabilities
of no safe mode, of a single one that the outages cover or do not, and of several.  Times are in days past
departure.  The arc ends with the last segment: afterwards the spacecraft coasts on the target, and no thrust
can be missed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
import scipy
from numpy.typing import NDArray

from core.analysis.weibull import RECOVERIES, SAFE_MODES, Weibull
from core.problem import Problem
from core.transcription.layout import CONTROL, checked_vector, layout_of

Array = NDArray[np.float64]

#: Which single safe modes an outage must cover: those that begin in a thrusting segment; those too that begin
#: on a coast and last into a thrusting segment; any on the arc.
Counted = Literal["thrusting", "lasting", "any"]

#: Throttle above which a segment counts as thrusting [-]; pictures draw the others as coasts.
THRUSTING = 0.02

# Of the integral over one segment, absolute [-].
_QUADRATURE = 1e-12


@dataclass(frozen=True, slots=True)
class Coverage:
    """Probabilities [-] of what may happen until the end of the last segment; the four add up to 1."""

    #: No safe mode begins.
    none: float
    #: Exactly one, and it misses no thrust, or an outage of the problem is at its segment and as long.
    one_covered: float
    #: Exactly one, and no outage of the problem stands for it.
    one_uncovered: float
    #: Two or more: never covered, since each realization has one outage.
    several: float
    #: From departure to the end of the last segment [days].
    arc_days: float

    @property
    def covered(self) -> float:
        """Probability that nothing happens or a realization stands for what does [-]."""
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
    """Return the probability that the outages of a problem cover what may happen to its reference.

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
    """Return the sums of what `chances` gives for each span [-]."""
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
        The longest outage that begins with each segment and does no harm [days].
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
    return [Span(edges[i], edges[i + 1], *_missed(i, edges, is_lit, allowed, counted)) for i in range(n + 1)]


def _missed(
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
