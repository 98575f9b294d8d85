"""Solutions against their own seeds, and strategies against each other, with the size of every sample.

Each test makes few assumptions.  A small p says that a difference is unlikely by chance alone, not that it is
large enough to matter.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import isnan, nan

import numpy as np
import scipy
from numpy.typing import ArrayLike

from core.analysis.campaign_facts import Level, SolveFacts
from core.analysis.campaign_statistics import BY_STRATEGY, Findings, columns_of_group, group_solves, solutions
from core.analysis.metrics import Ratio, Spread, feasibility_ratio, spread
from core.problem import Problem
from core.world import world_of


@dataclass(frozen=True, slots=True)
class PairedChange:
    """Propellant of solutions minus that of their own seeds: negative where the solution is cheaper."""

    search: str | None
    strategy: str | None
    duration_days: float | None
    mapping: str | None
    case: str | None
    level: Level
    #: Different seeds of the pairs; the number of pairs stands with the changes.
    n_seeds: int
    propellant_kg: Spread
    #: Of the transfer.
    delta_v_km_s: Spread
    #: Share of the pairs in which the solution needs less than its seed, by more than `negligible_kg`.
    cheaper: Ratio
    #: Two-sided signed-rank test of the propellant, one number per seed; below `negligible_kg` is no change.
    wilcoxon_p: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two groups of solves: how often they succeed, and what their solutions cost."""

    one: str
    other: str
    level: Level
    n_solves_one: int
    n_solutions_one: int
    n_solves_other: int
    n_solutions_other: int
    #: Two-sided test of the ratios, alone and corrected for all comparisons made with it.
    fisher_p: float
    fisher_holm_p: float
    #: Median delta-v of one minus that of the other [km/s].
    median_difference_km_s: float
    #: Common-language effect size: P(delta-v of one > that of the other), ties counted half [-].
    dearer: float
    #: Two-sided test of the delta-v, alone and corrected for all comparisons made with it.
    mann_whitney_p: float
    mann_whitney_holm_p: float


def paired_changes(
    findings: Findings, by: Sequence[str] = BY_STRATEGY, level: Level = "strict"
) -> tuple[PairedChange, ...]:
    """Return the paired changes of each group of solves that has seeds.

    Parameters
    ----------
    findings : Findings
        Of a campaign.
    by : sequence of str
        Attributes of `SolveFacts` that make the groups.
    level : "paper" or "strict"
        Tolerance of the solutions.
    """
    with_seeds = [solve for solve in findings.facts.solves if solve.seed_id is not None]
    return tuple(paired_change(findings, group, level) for group in group_solves(with_seeds, by).values())


def paired_change(findings: Findings, solves: Sequence[SolveFacts], level: Level = "strict") -> PairedChange:
    """Return how solutions differ from their own seeds, eq. (M8).

    Solutions without a seed, or whose seed is not of this campaign, form no pair.

    Parameters
    ----------
    findings : Findings
        Includes the solves that found the seeds.
    solves : sequence of SolveFacts
        May be empty.
    level : "paper" or "strict"
        Tolerance of the solutions.

    References
    ----------
    docs/method.md, "Metrics".
    """
    mass: dict[str, list[float]] = {}
    delta_v, least = [], negligible_kg(findings.facts.problem)
    for solve in solutions(solves, level):
        seed = findings.found_by.get(solve.seed_id or "")
        if seed is None or solve.seed_id is None:
            continue
        if solve.propellant_kg is not None and seed.propellant_kg is not None:
            mass.setdefault(solve.seed_id, []).append(solve.propellant_kg - seed.propellant_kg)
        if solve.delta_v_km_s is not None and seed.delta_v_km_s is not None:
            delta_v.append(solve.delta_v_km_s - seed.delta_v_km_s)
    changes = [change for pairs in mass.values() for change in pairs]
    return PairedChange(
        **columns_of_group(solves),
        level=level,
        n_seeds=len(mass),
        propellant_kg=spread(changes),
        delta_v_km_s=spread(delta_v),
        cheaper=feasibility_ratio(sum(change < -least for change in changes), len(changes)),
        wilcoxon_p=wilcoxon_p([_zero_below(float(np.mean(pairs)), least) for pairs in mass.values()]),
    )


def negligible_kg(problem: Problem) -> float:
    """Return the change of propellant that is below the accuracy of the verifier [kg].

    Where a realization costs nothing, a second solve returns the seed's reference to 1e-9 kg, and the sign of
    the difference is noise.
    """
    return world_of(problem).strict.mass_kg


def _zero_below(change_kg: float, least_kg: float) -> float:
    return 0.0 if abs(change_kg) <= least_kg else change_kg


def wilcoxon_p(changes: ArrayLike) -> float:
    """Return the two-sided p of the signed-rank test that changes are symmetric about zero.

    Zeros are dropped; p is 1 if all changes are zero, and NaN without any change.

    Parameters
    ----------
    changes : (n,) array
        In any unit [-].

    References
    ----------
    Wilcoxon, Biometrics Bulletin 1 (1945), 80-83; as in SciPy.
    """
    numbers = np.asarray(changes, dtype=np.float64)
    moved = numbers[numbers != 0.0]
    if not len(moved):
        return 1.0 if len(numbers) else nan
    return float(scipy.stats.wilcoxon(moved).pvalue)


def compare_groups(
    groups: Mapping[str, Sequence[SolveFacts]],
    pairs: Iterable[tuple[str, str]] | None = None,
    level: Level = "strict",
) -> tuple[Comparison, ...]:
    """Compare groups of solves pairwise, p-values corrected for all comparisons, eqs. (M9) to (M11).

    Parameters
    ----------
    groups : mapping of str to sequences of SolveFacts
        By the name to be shown; groups may be empty.
    pairs : iterable of (str, str)
        Which to compare; all of them by default.
    level : "paper" or "strict"
        Tolerance of the solutions.

    References
    ----------
    docs/method.md, "Metrics".
    """
    chosen = combinations(groups, 2) if pairs is None else pairs
    alone = [_comparison(one, groups[one], other, groups[other], level) for one, other in chosen]
    fisher = holm([each.fisher_p for each in alone])
    mann_whitney = holm([each.mann_whitney_p for each in alone])
    return tuple(
        replace(each, fisher_holm_p=p, mann_whitney_holm_p=q)
        for each, p, q in zip(alone, fisher, mann_whitney, strict=True)
    )


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values with Holm's correction for multiple comparisons, eq. (M11); NaN is left out.

    Parameters
    ----------
    p_values : sequence of float
        In any order, which is kept [-].

    References
    ----------
    Holm, Scandinavian Journal of Statistics 6 (1979), 65-70; docs/method.md, "Metrics".
    """
    members = sorted((i for i, p in enumerate(p_values) if not isnan(p)), key=lambda i: p_values[i])
    corrected, least = [nan] * len(p_values), 0.0
    for rank, i in enumerate(members):
        least = max(least, min(1.0, (len(members) - rank) * p_values[i]))
        corrected[i] = least
    return corrected


def _comparison(
    one: str, solves: Sequence[SolveFacts], other: str, others: Sequence[SolveFacts], level: Level
) -> Comparison:
    found, others_found = solutions(solves, level), solutions(others, level)
    fisher = nan
    if solves and others:
        table = [[len(found), len(solves) - len(found)], [len(others_found), len(others) - len(others_found)]]
        fisher = float(scipy.stats.fisher_exact(table).pvalue)
    difference, dearer, mann_whitney = _delta_v_test(_delta_v(found), _delta_v(others_found))
    return Comparison(
        one=one,
        other=other,
        level=level,
        n_solves_one=len(solves),
        n_solutions_one=len(found),
        n_solves_other=len(others),
        n_solutions_other=len(others_found),
        fisher_p=fisher,
        fisher_holm_p=nan,
        median_difference_km_s=difference,
        dearer=dearer,
        mann_whitney_p=mann_whitney,
        mann_whitney_holm_p=nan,
    )


def _delta_v(found: Iterable[SolveFacts]) -> list[float]:
    return [solve.delta_v_km_s for solve in found if solve.delta_v_km_s is not None]


def _delta_v_test(values: Sequence[float], others: Sequence[float]) -> tuple[float, float, float]:
    """Return the difference of medians, the common-language effect size, and p; eq. (M10)."""
    if not values or not others:
        return nan, nan, nan
    found = scipy.stats.mannwhitneyu(values, others)
    share = float(found.statistic) / (len(values) * len(others))
    return float(np.median(values) - np.median(others)), share, float(found.pvalue)
