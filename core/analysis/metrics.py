"""What a search and its solutions are worth, in numbers.

Feasibility ratios always come with their interval and their number of guesses: a ratio of 3 in 2,400 and
one of 3 in 30 are different statements.  Masses in kg, delta-v in km/s.
"""

from math import inf, log, sqrt
from typing import NamedTuple

from core.constants import G0
from core.problem import Problem, Spacecraft

#: Standard normal quantile of a two-sided 95 % interval, as the paper's tables are recomputed.
Z_95 = 1.96


class Ratio(NamedTuple):
    """A feasibility ratio with its 95 % Wilson interval [-]."""

    #: Feasible solutions per guess; not a number while there are no guesses.
    value: float
    low: float
    high: float


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

    Unlike the textbook normal interval it stays inside [0, 1] and is honest for the rare successes of a
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
    # At p = 0 and p = 1 one end is exactly 0 or 1, and rounding must not carry it outside.
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
        Masses before and after [kg]; a final mass of zero costs infinitely much.
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
