"""Metrics of a search and its solutions: feasibility ratios, delta-v, and their intervals.

Feasibility ratios always have an interval and a number of guesses: 3 of 2,400 and 3 of 30 are different
statements.  Masses in kg, delta-v in km/s.  Undefined values, as of an empty sample, are NaN.
"""

from collections.abc import Callable, Sequence
from math import exp, inf, isnan, log, nan, prod, sqrt
from typing import TYPE_CHECKING, NamedTuple

from core.constants import G0
from core.problem import Problem, Spacecraft

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

#: Standard normal quantile of a two-sided 95 % interval, as the paper's tables are recomputed.
Z_95 = 1.96


class Ratio(NamedTuple):
    """A feasibility ratio with its 95 % Wilson interval [-]."""

    #: Feasible solutions per guess; NaN without guesses.
    value: float
    low: float
    high: float


class Estimate(NamedTuple):
    """A number with its 95 % interval."""

    #: In the unit of its field, like both ends.
    value: float
    low: float
    high: float


class Spread(NamedTuple):
    """Summary statistics of numbers, in their own unit; all but n are NaN where n is too small."""

    #: Size of the sample.
    n: int
    mean: float
    #: 95 % interval of the mean, by Student's t.
    mean_low: float
    mean_high: float
    least: float
    lower_quartile: float
    median: float
    upper_quartile: float
    greatest: float


def feasibility_ratio(n_feasible: int, n_guesses: int) -> Ratio:
    """Return the share of guesses that ended feasible, with its interval.

    Parameters
    ----------
    n_feasible : int
        Guesses that ended in a feasible solution [-].
    n_guesses : int
        NLP solves started, failures included [-].
    """
    low, high = wilson_interval(n_feasible, n_guesses)
    return Ratio(n_feasible / n_guesses if n_guesses else float("nan"), low, high)


def wilson_interval(n_successes: int, n_trials: int, z: float = Z_95) -> tuple[float, float]:
    """Return the Wilson score interval of a binomial probability, docs/method.md eq. 23.

    Unlike the normal approximation it stays inside [0, 1] and has good coverage for the rare successes of a
    global search.  Without trials it is all of [0, 1].

    Parameters
    ----------
    n_successes, n_trials : int
        Counts with 0 <= n_successes <= n_trials [-].
    z : float
        Standard normal quantile of the level [-].

    Raises
    ------
    ValueError
        When the counts cannot be.

    References
    ----------
    Wilson, Journal of the American Statistical Association 22 (1927), 209-212.
    """
    if not 0 <= n_successes <= n_trials:
        raise ValueError(f"counts: expected 0 <= successes <= trials, got {n_successes} and {n_trials}")
    if n_trials == 0:
        return 0.0, 1.0
    p, share = n_successes / n_trials, z * z / n_trials
    centre = p + share / 2.0
    half_width = z * sqrt(p * (1.0 - p) / n_trials + share / (4.0 * n_trials))
    # At p = 0 and p = 1 one end is exactly 0 or 1, which rounding must not exceed.
    return max(0.0, (centre - half_width) / (1.0 + share)), min(1.0, (centre + half_width) / (1.0 + share))


def exhaust_velocity_km_s(spacecraft: Spacecraft) -> float:
    """Return the exhaust velocity c = isp g0 [km/s].

    Parameters
    ----------
    spacecraft : Spacecraft
        Its specific impulse is in s; g0 is the paper's [m/s^2].
    """
    return spacecraft.isp_s * G0 * 1e-3


def delta_v_km_s(spacecraft: Spacecraft, start_mass_kg: float, final_mass_kg: float) -> float:
    """Return the delta-v [km/s] that takes a spacecraft from one mass to another, c ln(m_0/m_f).

    Parameters
    ----------
    spacecraft : Spacecraft
        Its specific impulse is in s.
    start_mass_kg, final_mass_kg : float
        Masses before and after [kg]; a final mass of zero gives an infinite delta-v.
    """
    if final_mass_kg <= 0.0:
        return inf
    return exhaust_velocity_km_s(spacecraft) * log(start_mass_kg / final_mass_kg)


def transfer_delta_v_km_s(problem: Problem, departure_mass_kg: float, final_mass_kg: float) -> float:
    """Return the delta-v [km/s] of the transfer alone, from departure to arrival.

    Parameters
    ----------
    problem : Problem
        Gives the spacecraft.
    departure_mass_kg, final_mass_kg : float
        Masses at departure and at arrival [kg].
    """
    return delta_v_km_s(problem.spacecraft, departure_mass_kg, final_mass_kg)


def total_delta_v_km_s(problem: Problem, final_mass_kg: float) -> float:
    """Return the delta-v [km/s] of the mission, the spiral included.

    Parameters
    ----------
    problem : Problem
        Gives the spacecraft and its wet mass [kg].
    final_mass_kg : float
        Mass at arrival [kg].
    """
    return delta_v_km_s(problem.spacecraft, problem.spacecraft.wet_mass_kg, final_mass_kg)


def spread(values: "ArrayLike") -> Spread:
    """Return the mean with its interval, quartiles and extremes of numbers, eq. (M4).

    Student's t takes the numbers as independent; solutions of one seed are not quite.

    Parameters
    ----------
    values : (n,) array
        Finite numbers, in any unit [-].

    References
    ----------
    docs/method.md, "Metrics".
    """
    # Imported here: a list of campaigns shows ratios, and has no arrays.
    import numpy as np
    import scipy

    numbers = np.asarray(values, dtype=np.float64)
    n = len(numbers)
    if n == 0:
        return Spread(0, nan, nan, nan, nan, nan, nan, nan, nan)
    mean = float(np.mean(numbers))
    half_width = (
        float(scipy.special.stdtrit(n - 1, 0.975) * np.std(numbers, ddof=1) / sqrt(n)) if n > 1 else nan
    )
    least, lower, median, upper, greatest = (float(q) for q in np.quantile(numbers, [0, 0.25, 0.5, 0.75, 1]))
    return Spread(n, mean, mean - half_width, mean + half_width, least, lower, median, upper, greatest)


def propagate_interval(quantity: Callable[[Sequence[float]], float], ratios: Sequence[Ratio]) -> Estimate:
    """Return a function of independent ratios, with the interval propagate_interval from theirs, eq. (M7).

    The distances to the limits of each ratio are added in quadrature, in the logarithm of the quantity.
    While some ratio is zero or unknown, only the end that follows from all limits at once is known.

    Parameters
    ----------
    quantity : callable
        Positive for positive ratios, and monotonic in each of them.
    ratios : sequence of Ratio
        With their Wilson intervals [-].

    References
    ----------
    Zou and Donner, Statistics in Medicine 27 (2008), 1693-1702; docs/method.md, "Metrics".
    """
    values = [ratio.value for ratio in ratios]
    if not all(value > 0.0 for value in values):
        return Estimate(nan, quantity([ratio.high for ratio in ratios]), inf)
    value, below, above = quantity(values), 0.0, 0.0
    for i, ratio in enumerate(ratios):
        ends = [quantity([*values[:i], end, *values[i + 1 :]]) for end in (ratio.low, ratio.high)]
        below += log(value / min(ends)) ** 2
        above += log(max(ends) / value) ** 2
    return Estimate(value, value * exp(-sqrt(below)), value * exp(sqrt(above)))


def product_ratio(ratios: Sequence[Ratio]) -> Ratio:
    """Return the product of independent ratios with its interval, eqs. (M5) and (M7).

    Parameters
    ----------
    ratios : sequence of Ratio
        At least one, with their Wilson intervals [-].

    References
    ----------
    docs/method.md, "Metrics".
    """
    if any(isnan(ratio.value) or ratio.value == 0.0 for ratio in ratios):
        return Ratio(prod(ratio.value for ratio in ratios), 0.0, prod(ratio.high for ratio in ratios))
    value, low, high = propagate_interval(prod, ratios)
    return Ratio(value, low, min(1.0, high))
