"""Cumulative cost of a strategy, including the searches that produced its seeds.

A conditional ratio does not include the cost of its seeds.  The paper multiplies ratios and adds hours per
solution along the chain; but each solve uses a seed, so the full cost counts each seed as often as it is
tried.  Hours are core-hours.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import Literal

from core.analysis.campaign_facts import Level, SolveFacts
from core.analysis.campaign_statistics import Findings, cost_of, group_solves, shared, solutions
from core.analysis.metrics import Estimate, Ratio, feasibility_ratio, product_ratio, propagate_interval

#: Spent, limited by the CPU cap, or charged as in the paper: fields of `campaign_statistics.Cost`.
Currency = Literal["core_hours", "cap_hours", "charged_hours"]


@dataclass(frozen=True, slots=True)
class Link:
    """The solves of one strategy in a seed chain."""

    strategy: str
    n_solves: int
    n_solutions: int
    #: Different seeds used; 0 at the start of the chain.
    n_seeds: int
    #: All solves together.
    hours: float

    @property
    def ratio(self) -> Ratio:
        """Solutions per solve."""
        return feasibility_ratio(self.n_solutions, self.n_solves)

    @property
    def hours_per_solve(self) -> float:
        """Mean over the solves, failures included."""
        return self.hours / self.n_solves if self.n_solves else nan

    @property
    def seeds_per_solve(self) -> float:
        """1 if each seed is used once, less if it serves several cases or mappings."""
        return self.n_seeds / self.n_solves if self.n_solves else nan


#: Source of seeds that no solve of the campaign found.
_UNKNOWN = Link("?", 0, 0, 0, 0.0)


@dataclass(frozen=True, slots=True)
class Cumulative:
    """Ratio and cost of a seed chain as a whole."""

    #: From the last strategy to the first, as in "S(3|2) <- S(2|0) <- S(0)".
    chain: str
    search: str | None
    strategy: str
    duration_days: float | None
    mapping: str | None
    #: Of its own solutions; its seeds count at the level required of them.
    level: Level
    currency: Currency
    #: Product of the ratios.
    ratio: Ratio
    #: Sum of the hours per solution, as in the paper.
    hours: Estimate
    #: Hours per solution if each seed is tried once.
    full_hours: Estimate
    #: Hours per solution including the seeds used, each counted once however often it was tried.
    shared_hours: Estimate


def cumulative_ratio(links: Sequence[Link]) -> Ratio:
    """Return the product of the ratios of a seed chain with its interval, eq. (M5).

    Parameters
    ----------
    links : sequence of Link
        From the search without seeds on; at least one.

    References
    ----------
    docs/method.md, "Metrics".
    """
    return product_ratio([link.ratio for link in links])


def cumulative_hours(links: Sequence[Link]) -> Estimate:
    """Return the sum of the hours per solution along a seed chain, as in the paper, eq. (M5).

    Parameters
    ----------
    links : sequence of Link
        From the search without seeds on; at least one.

    References
    ----------
    docs/method.md, "Metrics".
    """
    hours = [link.hours_per_solve for link in links]

    def total(ratios: Sequence[float]) -> float:
        return sum(each / ratio for each, ratio in zip(hours, ratios, strict=True))

    return propagate_interval(total, [link.ratio for link in links])


def full_hours(links: Sequence[Link], *, is_shared: bool = False) -> Estimate:
    """Return the hours per solution including those of all seeds used, eq. (M6).

    Parameters
    ----------
    links : sequence of Link
        From the search without seeds on; at least one.
    is_shared : bool
        Whether a seed used by several solves is counted once; else once for each solve.

    References
    ----------
    docs/method.md, "Metrics".
    """
    hours = [link.hours_per_solve for link in links]
    seeds = [link.seeds_per_solve if is_shared else 1.0 for link in links]

    def full(ratios: Sequence[float]) -> float:
        cost = 0.0
        for each, n_seeds, ratio in zip(hours, seeds, ratios, strict=True):
            cost = (n_seeds * cost + each) / ratio
        return cost

    return propagate_interval(full, [link.ratio for link in links])


def seed_chains(
    findings: Findings,
    level: Level = "strict",
    currency: Currency = "core_hours",
    by: Sequence[str] = ("search", "duration_days"),
) -> tuple[Cumulative, ...]:
    """Return the cumulative cost of each search, for each of its groups.

    The seeds of a group are those found by the search that it names, at the durations at which its seeds were
    found; seeds from elsewhere have an unknown cost.

    Parameters
    ----------
    findings : Findings
        Of a campaign.
    level : "paper" or "strict"
        Tolerance at which the solutions of each search are counted; those of the searches behind it count at
        the level at which they could be seeds.
    currency : "core_hours", "cap_hours" or "charged_hours"
        What is counted.
    by : sequence of str
        Attributes of `SolveFacts` that make the groups, "search" among them.

    Raises
    ------
    ValueError
        When the groups would mix searches.

    References
    ----------
    docs/method.md, "Metrics".
    """
    if "search" not in by:
        raise ValueError(f"groups: expected search among the attributes, got {', '.join(by)}")
    chains = _Chains(findings, currency)
    groups = group_solves(findings.facts.solves, by).values()
    return tuple(_cumulative(chains.links(group, level), group, level, currency) for group in groups)


class _Chains:
    """Traces the solves of a campaign back to those that found their seeds."""

    def __init__(self, findings: Findings, currency: Currency) -> None:
        self.findings, self.currency = findings, currency
        self.groups = group_solves(findings.facts.solves, ("search", "duration_days"))
        self.known: dict[tuple[str, frozenset[float | None], Level], list[Link]] = {}

    def links(self, solves: Sequence[SolveFacts], level: Level) -> list[Link]:
        """Return the seed chain of some solves of one search, the search without seeds first."""
        if not solves:
            return [_UNKNOWN]
        seeds = {solve.seed_id for solve in solves if solve.seed_id is not None}
        n_solutions = len(solutions(solves, level))
        hours = float(getattr(cost_of(solves), self.currency))
        link = Link(solves[0].strategy, len(solves), n_solutions, len(seeds), hours)
        source, seed_level = solves[0].seeds_from, solves[0].seed_level
        if source is None or seed_level is None:
            return [link]
        found = [self.findings.found_by[name] for name in seeds if name in self.findings.found_by]
        durations = frozenset(solve.duration_days for solve in found)
        return [*self._source(source, durations, seed_level), link]

    def _source(self, search: str, durations: frozenset[float | None], level: Level) -> list[Link]:
        key = search, durations, level
        if key not in self.known:
            # Set before the recursion, so that a cycle of searches ends in the unknown.
            self.known[key] = [_UNKNOWN]
            givers = [one for days in durations for one in self.groups.get((search, days), ())]
            self.known[key] = self.links(givers, level)
        return self.known[key]


def _cumulative(
    links: Sequence[Link], group: Sequence[SolveFacts], level: Level, currency: Currency
) -> Cumulative:
    return Cumulative(
        chain=" <- ".join(link.strategy for link in reversed(links)),
        search=group[0].search,
        strategy=group[0].strategy,
        duration_days=shared(solve.duration_days for solve in group),
        mapping=shared(solve.mapping for solve in group),
        level=level,
        currency=currency,
        ratio=cumulative_ratio(links),
        hours=cumulative_hours(links),
        full_hours=full_hours(links),
        shared_hours=full_hours(links, is_shared=True),
    )
