"""Outage response of one trajectory: which outages it recovers from, at what cost, and its survivability.

Input: a problem, its reference, the results of recoveries from outages of several segments and durations,
each with a frozen reference (`core.search.solve_recovery`), and the two probability distributions of outages.
Output: maps (segment x duration) of propellant and delay, the longest outage that each segment tolerates, and
the probabilities of no safe mode, of a single one with and without a recovery, and of several.

A recovery from an outage is also one from any shorter outage of the same segment: the spacecraft only waits
longer.  So a cell has the cheapest recovery of its duration or a longer one, and the cost never decreases
with the duration.  Times are in days past departure.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.analysis.safe_modes import (
    RECOVERIES,
    SAFE_MODES,
    THRUSTING,
    Coverage,
    Weibull,
    chances,
    coverage_of,
    spans_of,
)
from core.problem import Outage, Problem
from core.transcription.layout import CONTROL, TrajectoryLayout, checked_vector, layout_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Attempt(NamedTuple):
    """An attempt to recover from one outage."""

    outage: Outage
    #: Mass at arrival [kg] and end of the last burn [days past departure]; None where it did not succeed.
    recovered: tuple[float, float] | None


@dataclass(frozen=True, slots=True, eq=False)
class MissedThrust:
    """Outage response of one trajectory; rows are segments, columns durations."""

    #: (n,) segments at whose start outages begin, counted from 1, and (m,) how long they last [days].
    segments: Indices
    durations_days: Array
    #: (n,) when each segment begins [days past departure], and the reference's throttle in it [-].
    starts_days: Array
    throttles: Array
    #: Mass of the reference at arrival [kg], and the end of its last burn [days past departure].
    final_mass_kg: float
    arrival_days: float
    #: (n, m) whether a recovery was tried, or is known from a longer outage.
    is_tried: NDArray[np.bool_]
    #: (n, m) propellant beyond the reference's [kg], delay of the last burn's end [days]; NaN: no recovery.
    propellant_kg: Array
    delay_days: Array
    #: (n,) the longest outage with a recovery [days]; 0 where there is none.
    longest_days: Array

    @property
    def is_open(self) -> NDArray[np.bool_]:
        """(n,) whether the longest outage requested has a recovery, so that longer ones may have one too."""
        return np.asarray(self.longest_days >= self.durations_days[-1])


def missed_thrust(problem: Problem, x: Array, attempts: Iterable[Attempt]) -> MissedThrust:
    """Return the response of a trajectory to the outages that were tried.

    Parameters
    ----------
    problem : Problem
        P_k.
    x : (n_variables,) array
        Its decision vector [days, rad, kg], of which the reference is used.
    attempts : iterable of Attempt
        In any order; several at the same outage are alternatives.

    Raises
    ------
    ValueError
        When x does not fit the problem, or there are no attempts.

    References
    ----------
    docs/missed-thrust.md.
    """
    tried = list(attempts)
    if not tried:
        raise ValueError("attempts: expected at least one outage, got none")
    own = layout_of(problem).reference
    vector = checked_vector(layout_of(problem), x)
    segments = np.unique([one.outage.segment for one in tried])
    durations = np.unique([one.outage.duration_days for one in tried])
    mass, arrival = float(vector[own.final_mass]), _last_burn(vector, own, 0.0)
    is_tried, kept, late = _cells(segments, durations, tried)
    cheapest, delay = _cheapest(mass - kept, late - arrival)
    is_known = np.isfinite(cheapest)
    return MissedThrust(
        segments=segments,
        durations_days=durations,
        starts_days=_begin(vector, own, segments),
        throttles=vector[own.controls][::CONTROL][segments - 1],
        final_mass_kg=mass,
        arrival_days=arrival,
        is_tried=is_tried | is_known,
        propellant_kg=cheapest,
        delay_days=delay,
        longest_days=np.max(np.where(is_known, durations, 0.0), axis=1),
    )


def attempt(problem: Problem, x: Array | None) -> Attempt:
    """Return the attempt that a solve of P_1 represents.

    Parameters
    ----------
    problem : Problem
        P_1.
    x : (n_variables,) array
        Its solution [days, rad, kg]; None if none was found.

    Raises
    ------
    ValueError
        When the problem has not exactly one outage, or x does not fit it.
    """
    if problem.k != 1:
        raise ValueError(f"problem: expected one outage, got {problem.k}")
    (outage,) = problem.outages
    if x is None:
        return Attempt(outage, None)
    reference, own = layout_of(problem).trajectories
    vector = checked_vector(layout_of(problem), x)
    over = float(_begin(vector, reference, np.array([outage.segment]))[0]) + outage.duration_days
    return Attempt(outage, (float(vector[own.final_mass]), _last_burn(vector, own, over)))


def _cells(
    segments: Indices, durations: Array, tried: Sequence[Attempt]
) -> tuple[NDArray[np.bool_], Array, Array]:
    """Return which cells were tried, and mass and time of arrival of the heaviest recovery in each."""
    shape = len(segments), len(durations)
    is_tried, kept, late = np.zeros(shape, dtype=bool), np.full(shape, np.nan), np.full(shape, np.nan)
    for outage, recovered in tried:
        row = np.searchsorted(segments, outage.segment)
        column = np.searchsorted(durations, outage.duration_days)
        is_tried[row, column] = True
        if recovered is not None and not kept[row, column] >= recovered[0]:
            kept[row, column], late[row, column] = recovered
    return is_tried, kept, late


def _cheapest(cost: Array, delay: Array) -> tuple[Array, Array]:
    """Return cost and delay of the cheapest recovery of each cell's duration or a longer one."""
    cost, delay = cost.copy(), delay.copy()
    for column in range(cost.shape[1] - 2, -1, -1):
        is_better = ~(cost[:, column] <= cost[:, column + 1]) & np.isfinite(cost[:, column + 1])
        cost[is_better, column] = cost[is_better, column + 1]
        delay[is_better, column] = delay[is_better, column + 1]
    return cost, delay


def _begin(x: Array, own: TrajectoryLayout, segments: Indices) -> Array:
    """Return when segments of the reference begin [days past departure]."""
    share = (segments - 1) / own.n_segments
    return np.asarray(x[own.initial_coast] + share * x[own.shooting_time])


def _last_burn(x: Array, own: TrajectoryLayout, begin: float) -> float:
    """Return the end of a trajectory's last burn; what follows is a coast on the target [days]."""
    lit = np.flatnonzero(x[own.controls][::CONTROL] > THRUSTING)
    share = (lit[-1] + 1) / own.n_segments if len(lit) else 0.0
    return float(begin + x[own.initial_coast] + share * x[own.shooting_time])


@dataclass(frozen=True, slots=True, eq=False)
class Survivability:
    """Probabilities of safe modes until the end of the last segment of a trajectory."""

    #: With the outages that have a recovery; `one_uncovered` are those that have none.
    least: Coverage
    #: The same if segments with a recovery from the longest outage that was tried have one from any.
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
    """Return the probability that a trajectory reaches its target with at most one outage.

    A safe mode inside a thrusting segment counts as the outage that begins with the segment; one on a coast
    misses thrust only from the next thrusting segment on.  A segment that was left out has the longest outage
    of its weaker neighbour.

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
        every = _interpolate(found, allowed, problem.n_segments)
        spans = spans_of(problem, x, every.tolist(), THRUSTING, "lasting")
        single.append([chances(span, spans[-1].stop, between, recovery) for span in spans])
    least, most = (coverage_of(spans, one, between) for one in single)
    lost = np.array([begun - covered for begun, covered in single[0]])
    return Survivability(least, most, np.maximum(lost, 0.0))


def fragile_segments(
    problem: Problem, x: Array, found: MissedThrust, recovery: Weibull = RECOVERIES
) -> list[int]:
    """Return the thrusting segments without a recovery from an outage of median length, the weakest first.

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
    # Where nothing as long was tried, the last duration is used.
    wanted = min(recovery.median(), float(found.durations_days[-1]))
    weak = np.flatnonzero(is_lit & (found.longest_days < wanted))
    order = sorted(weak, key=lambda row: (found.longest_days[row], found.segments[row]))
    return [int(found.segments[row]) for row in order]


def _interpolate(found: MissedThrust, allowed: Array, n_segments: int) -> Array:
    """Return the longest outage of every segment: between two that were tried, the lesser."""
    segments = np.arange(1, n_segments + 1)
    last = len(found.segments) - 1
    after = np.searchsorted(found.segments, segments)
    right, left = np.minimum(after, last), np.clip(after - 1, 0, last)
    is_tried = found.segments[right] == segments
    left = np.where(is_tried, right, np.where(after > last, last, left))
    return np.asarray(np.minimum(allowed[left], allowed[right]))
