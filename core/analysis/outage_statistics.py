"""How often thrust is lost and for how long: counts of safe modes on an arc, durations of outages.

What flows in: Weibull laws and the length of an arc in days.  What flows out: probabilities.  Safe modes form
a renewal process that starts with the arc: the times between them, the first one included, are independent
and of one law.  The time that outages themselves last is neglected.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import asinh, ceil, pi
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import ArrayLike, NDArray

from core.analysis.coverage import Coverage, coverage
from core.analysis.weibull import RECOVERIES, SAFE_MODES, Weibull

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
        """Probability of exactly one where there is one or more [-]; not a number on an arc of no length."""
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
    # Rounding may leave a count that cannot be at -1e-16.
    counts = np.maximum(_counts(arc_days, n_max, between), 0.0)
    mean = float(np.arange(len(counts)) @ counts)
    return CountDistribution(arc_days, counts[: n_max + 1], mean)


def _counts(arc_days: float, n_max: int, between: Weibull) -> Array:
    """Return P(0), P(1), .. until nothing is left, at the lowest degree that half of it confirms."""
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
    # Where the degree is too low, counts may grow instead of ending.
    while (len(counts) <= least or counts[-1] > _TAIL) and abs(counts[-1]) < 2.0:
        chance = Chebyshev.interpolate(partial(convolve.next, chance), degree, domain=domain)
        counts.append(float(chance(last)))
    return np.array(counts)


_Chance = Callable[[Array], Array]


class _Convolution(NamedTuple):
    """P(n + 1) from P(n): docs/method.md, section 13 (R3).

    In the time, P(n) has a power that is no integer at 0.  In the hazard h it is entire, and so it is in
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
    """A probability in words that say what it is the probability of."""

    sentence: str
    #: Computed from the laws [-].
    value: float
    #: The number that the paper gives, which its words attach to something else; None where it has none [-].
    paper: float | None


def quoted_statements(between: Weibull = SAFE_MODES, recovery: Weibull = RECOVERIES) -> tuple[Statement, ...]:
    """Return what the paper's three numbers about outages are, computed and in full.

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
