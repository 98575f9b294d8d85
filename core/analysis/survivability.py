"""How probable it is that a trajectory survives a missed thrust, and where it is fragile.

What flows in: a missed-thrust analysis and the two laws of outages.  What flows out: the probabilities of no
safe mode, of a single one with and without a recovery, and of several; and what each segment has of the loss.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.analysis.coverage import THRUSTING, Coverage, chances, coverage_of, spans_of
from core.analysis.missed_thrust import MissedThrust
from core.analysis.weibull import RECOVERIES, SAFE_MODES, Weibull
from core.problem import Problem
from core.transcription.layout import CONTROL, checked_vector, layout_of

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Survivability:
    """What may happen to a trajectory until the end of its last segment."""

    #: With the outages that have a recovery; `one_uncovered` are those that have none.
    least: Coverage
    #: The same if segments that take the longest outage that was tried take any.
    most: Coverage
    #: (N + 1,) probability that the one safe mode begins on the initial coast or in a segment and has no
    #: recovery [-]; they add up to `least.one_uncovered`.
    lost: Array

    @property
    def recovered_given_one(self) -> tuple[float, float]:
        """Probability of a recovery from a single safe mode, at least and at most [-]."""
        return self.least.one_covered / self.least.one, self.most.one_covered / self.most.one


def survivability(
    problem: Problem,
    x: Array,
    found: MissedThrust,
    between: Weibull = SAFE_MODES,
    recovery: Weibull = RECOVERIES,
) -> Survivability:
    """Return the probability that a trajectory reaches its target whatever single outage comes.

    A safe mode inside a thrusting segment counts as the outage that begins with the segment; one on a coast
    misses thrust only from the next thrusting segment on.  A segment that was left out takes what the weaker
    of its neighbours takes.

    Parameters
    ----------
    problem : Problem
        P_k.
    x : (n_variables,) array
        Its decision vector [days, rad, kg], of which the reference is used.
    found : MissedThrust
        The analysis of it.
    between, recovery : Weibull
        Laws of the time between safe modes, to the first one from departure, and of durations [days].

    References
    ----------
    docs/method.md, "Coverage"; docs/missed-thrust.md.
    """
    single = []
    for allowed in (found.longest_days, np.where(found.is_open, np.inf, found.longest_days)):
        every = _for_all(found, allowed, problem.n_segments)
        spans = spans_of(problem, x, every.tolist(), THRUSTING, "lasting")
        single.append([chances(span, spans[-1].stop, between, recovery) for span in spans])
    least, most = (coverage_of(spans, one, between) for one in single)
    lost = np.array([begun - covered for begun, covered in single[0]])
    return Survivability(least, most, np.maximum(lost, 0.0))


def fragile_segments(
    problem: Problem, x: Array, found: MissedThrust, recovery: Weibull = RECOVERIES
) -> list[int]:
    """Return the thrusting segments that do not take an outage of median length, the weakest first.

    Parameters
    ----------
    problem : Problem
        P_k.
    x : (n_variables,) array
        Its decision vector [days, rad, kg], of which the reference is used.
    found : MissedThrust
        The analysis of it.
    recovery : Weibull
        Law of durations [days].
    """
    vector = checked_vector(layout_of(problem), x)
    throttles = vector[layout_of(problem).reference.controls][::CONTROL]
    is_lit = throttles[found.segments - 1] > THRUSTING
    # Where nothing as long was tried, the last duration has to do.
    wanted = min(recovery.median(), float(found.durations_days[-1]))
    weak = np.flatnonzero(is_lit & (found.longest_days < wanted))
    order = sorted(weak, key=lambda row: (found.longest_days[row], found.segments[row]))
    return [int(found.segments[row]) for row in order]


def _for_all(found: MissedThrust, allowed: Array, n_segments: int) -> Array:
    """Return what every segment takes: between two that were tried, the less."""
    segments = np.arange(1, n_segments + 1)
    last = len(found.segments) - 1
    after = np.searchsorted(found.segments, segments)
    right, left = np.minimum(after, last), np.clip(after - 1, 0, last)
    is_tried = found.segments[right] == segments
    left = np.where(is_tried, right, np.where(after > last, last, left))
    return np.asarray(np.minimum(allowed[left], allowed[right]))
