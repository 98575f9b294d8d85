"""Feasibility ratios and costs per solution, by strategy, mapping and duration, and by case."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from core.analysis.campaign_facts import CampaignFacts, SolveFacts
from core.analysis.campaign_statistics import (
    Findings,
    SeedYield,
    Summary,
    case_name,
    cost_of,
    findings_of,
    group_solves,
    seed_yields,
    solutions,
    summarize,
)
from core.analysis.metrics import Ratio, Spread, feasibility_ratio, spread
from core.world import World, world_of
from service.report.beside import Beside
from service.report.page import Section
from service.report.plots import (
    SECONDS_PER_HOUR,
    Chart,
    Row,
    Series,
    duration_label,
    number,
    percent,
    seconds_per_solution,
    strategy_key,
)
from service.report.style import BLUE, GREEN
from service.report.tables import Cell, Column, Table

#: Strategy with its mapping, and duration of the outages [days], None where a case mixes durations.
Key = tuple[str, float | None]
#: A strategy without further words uses this mapping, the default of a specification.
DEFAULT_MAPPING = "reference"


@dataclass(frozen=True, slots=True, eq=False)
class Groups:
    """What several sections need."""

    findings: Findings
    #: Sorted by number of outages, then without seeds first, then by duration; solves in order of address.
    solves: Mapping[Key, Sequence[SolveFacts]]
    #: Of the same groups, at the strict tolerance.
    summaries: Mapping[Key, Summary]
    #: Published values to show beside them.
    beside: Beside
    #: In which the campaign's problems fly.
    world: World


@dataclass(frozen=True, slots=True)
class Counts:
    """The cheap part of a summary, for groups as many as cases."""

    n_solves: int
    n_paper: int
    n_strict: int
    paper_ratio: Ratio
    strict_ratio: Ratio
    core_hours: float
    #: Of strict solutions; delta-v of the transfer.
    delta_v_km_s: Spread
    propellant_kg: Spread


def counts_of(solves: Sequence[SolveFacts]) -> Counts:
    """Return counts, ratios, cost and spreads of a group of solves."""
    found = solutions(solves, "strict")
    n_solves, n_paper, n_strict = len(solves), len(solutions(solves, "paper")), len(found)
    return Counts(
        n_solves=n_solves,
        n_paper=n_paper,
        n_strict=n_strict,
        paper_ratio=feasibility_ratio(n_paper, n_solves),
        strict_ratio=feasibility_ratio(n_strict, n_solves),
        core_hours=cost_of(solves).core_hours,
        delta_v_km_s=spread([v for one in found if (v := one.delta_v_km_s) is not None]),
        propellant_kg=spread([v for one in found if (v := one.propellant_kg) is not None]),
    )


def groups_of(facts: CampaignFacts, beside: Beside) -> Groups:
    """Return the groups of a campaign."""
    findings = findings_of(facts)
    solves = _by_strategy(facts.solves)
    summaries = {key: replace(summarize(findings, group), strategy=key[0]) for key, group in solves.items()}
    return Groups(findings, solves, summaries, beside, world_of(facts.problem))


def label_of(strategy: str, mapping: str | None) -> str:
    """Return the label of a strategy: its name, with the form of a mapping that is not the default.

    Published values belong to the default, so that other mappings must not share its name.
    """
    if mapping is None or mapping == DEFAULT_MAPPING:
        return strategy
    form, _, sources = mapping.partition("(")
    return f"{strategy} {form}{' from realizations' if sources and form == DEFAULT_MAPPING else ''}"


def _by_strategy(solves: Iterable[SolveFacts]) -> dict[Key, list[SolveFacts]]:
    found: dict[Key, list[SolveFacts]] = {}
    # A hundred thousand solves have some dozen cases: compute the duration of each once.
    durations: dict[tuple[tuple[int, float], ...], float | None] = {}
    for solve in solves:
        if solve.outages not in durations:
            durations[solve.outages] = solve.duration_days
        label = label_of(solve.strategy, solve.mapping)
        found.setdefault((label, durations[solve.outages]), []).append(solve)
    ordered = sorted(found, key=lambda key: (*strategy_key(key[0]), key[0], key[1] or 0.0))
    return {key: found[key] for key in ordered}


INTERVALS = "Intervals are Wilson's, 95 %."
OPEN = "A line without a mark: no solution so far."


def strategies_section(groups: Groups) -> Section:
    """Return the tables and figures of ratios and times."""
    found = list(groups.summaries.values())
    drawn = [one for one in found if "|" not in (one.strategy or "")]
    seeded = [one for one in found if "|" in (one.strategy or "")]
    tables = []
    for kind, some in (("non-conditional", drawn), ("conditional", seeded)):
        if some:
            both = (_ratio_table(some, kind), _cost_table(some, kind))
            tables += [groups.beside.join_table(table, some) for table in both]
    if seeded:
        tables.append(_yields(seed_yields(groups.findings.facts.solves)))
    charts = (_ratios(found), _times(found))
    return Section(
        "strategies",
        "Feasibility and time",
        (
            "Every solve started counts as a guess, failures included. The loose tolerance is "
            f"{groups.world.loose}, the strict one {groups.world.strict}; an independent propagation checks "
            "both.",
        ),
        tuple(tables),
        tuple(groups.beside.join_chart(chart, found).picture() for chart in charts),
    )


KINDS = {
    "non-conditional": "Non-conditional: guesses are drawn",
    "conditional": "Conditional: guesses are mapped from seeds",
}


def _ratio_table(groups: Sequence[Summary], kind: str) -> Table:
    columns = (
        Column("strategy", "strategy"),
        Column("outage, days", "duration_days", 1),
        Column("cases", "n_cases"),
        Column("solves", "n_solves"),
        Column("strict solutions", "n_strict"),
        Column("ratio, %, strict", "strict_ratio_percent"),
        Column("loose solutions", "n_paper"),
        Column("ratio, %, loose", "paper_ratio_percent"),
    )
    return Table(kind, KINDS[kind], INTERVALS, columns, tuple(_ratio_cells(one) for one in groups))


def _ratio_cells(one: Summary) -> tuple[Cell, ...]:
    return (
        one.strategy,
        one.duration_days or None,
        *(one.n_cases, one.n_solves),
        *(one.n_strict, percent(one.strict_ratio)),
        *(one.n_paper, percent(one.paper_ratio)),
    )


def _cost_table(groups: Sequence[Summary], kind: str) -> Table:
    columns = (
        Column("strategy", "strategy"),
        Column("outage, days", "duration_days", 1),
        Column("distinct solutions", "n_distinct"),
        Column("distinct per core-hour", "distinct_per_core_hour"),
        Column("core-s per strict solution", "core_seconds_per_strict"),
        Column("core-s at the cap, same", "cap_seconds_per_strict"),
        Column("core-s per loose solution", "core_seconds_per_paper"),
    )
    caption = (
        "Core-seconds are the CPU time of all solves, failures included; at the cap, what they were allowed. "
        "Intervals follow from those of the ratios. Distinct: strict solutions whose references differ, "
        "counted within each case."
    )
    rows = tuple(_cost_cells(one) for one in groups)
    return Table(f"{kind}-cost", "What a solution costs", caption, columns, rows)


def _cost_cells(one: Summary) -> tuple[Cell, ...]:
    return (
        one.strategy,
        one.duration_days or None,
        *(one.n_distinct, number(one.distinct_per_core_hour)),
        seconds_per_solution(one.cost.core_hours, one.n_solves, one.strict_ratio),
        number(one.cost_per_strict.cap_hours * SECONDS_PER_HOUR),
        seconds_per_solution(one.cost.core_hours, one.n_solves, one.paper_ratio),
    )


def _yields(found: Sequence[SeedYield]) -> Table:
    columns = (
        Column("seeds from", "seeds_of"),
        Column("target", "target"),
        Column("seeds used", "n_seeds"),
        Column("solves", "n_solves"),
        Column("strict solutions", "n_strict"),
        Column("ratio, %, strict", "strict_ratio_percent"),
        Column("core-s per strict solution", "core_seconds_per_strict"),
    )
    rows = tuple(
        (
            "drawn" if one.seed_k is None else f"P_{one.seed_k}",
            f"P_{one.k}",
            *(one.n_seeds, one.n_solves, one.n_strict),
            percent(one.strict_ratio),
            number(one.core_seconds_per_strict),
        )
        for one in found
    )
    caption = (
        f"Seeds by the problem that they are mapped to, all durations and mappings together. {INTERVALS}"
    )
    return Table("seed-yields", "Seeds and targets", caption, columns, rows)


def _ratios(groups: Sequence[Summary]) -> Chart:
    rows = [
        Row(
            one.strategy or "",
            duration_label(one.duration_days),
            (percent(one.paper_ratio), percent(one.strict_ratio)),
        )
        for one in groups
    ]
    series = (Series("loose", BLUE), Series("strict", GREEN, "s"))
    caption = (
        f"Feasible solutions per solve, n = {_n(groups)} solves, by strategy and duration of the outages, "
        f"logarithmic. {INTERVALS} {OPEN}"
    )
    return Chart("feasibility", "Feasibility ratio", caption, "feasible solves, %", series, rows)


def _n(groups: Sequence[Summary]) -> str:
    return f"{sum(one.n_solves for one in groups):,}"


def _times(groups: Sequence[Summary]) -> Chart:
    rows = [
        Row(
            one.strategy or "",
            duration_label(one.duration_days),
            tuple(
                seconds_per_solution(hours, one.n_solves, one.paper_ratio)
                for hours in (one.cost.core_hours, one.cost.cap_hours)
            ),
        )
        for one in groups
    ]
    series = (Series("spent", BLUE), Series("charged at the cap", GREEN, "s"))
    caption = (
        f"Core-time per loose solution, n = {_n(groups)} solves, failures included, logarithmic. "
        f"Intervals follow from those of the ratios (Wilson, 95 %). {OPEN}"
    )
    return Chart("time", "Time per solution", caption, "core-time per solution", series, rows, is_time=True)


COLUMNS = (
    Column("outages at", "case"),
    Column("outage, days", "duration_days", 1),
    Column("strategy", "strategy"),
    Column("solves", "n_solves"),
    Column("loose solutions", "n_paper"),
    Column("ratio, %, loose", "paper_ratio_percent"),
    Column("strict solutions", "n_strict"),
    Column("ratio, %, strict", "strict_ratio_percent"),
    Column("core-s per strict solution", "core_seconds_per_strict"),
    Column("least delta-v, km/s", "least_delta_v_km_s", 3),
    Column("median delta-v, km/s", "median_delta_v_km_s", 3),
    Column("least propellant, kg", "least_propellant_kg", 1),
)


def cases_section(groups: Groups) -> Section:
    """Return the tables by case, one for each number of outages."""
    by_k: dict[int, list[_Case]] = {}
    for solves in group_solves(groups.findings.facts.solves, ("outages", "strategy")).values():
        first = solves[0]
        by_k.setdefault(first.k, []).append(_Case(first.outages, first.strategy, counts_of(solves)))
    paragraph = "A case is a set of outages, named by the segments at which they begin."
    paragraph += groups.beside.sentence("cases")
    tables = tuple(_table(k, sorted(by_k[k], key=_Case.order)) for k in sorted(by_k))
    return Section("cases", "Case by case", (paragraph,), tables)


class _Case(NamedTuple):
    """What one strategy found for one case."""

    outages: tuple[tuple[int, float], ...]
    strategy: str
    tally: Counts

    @property
    def duration_days(self) -> float | None:
        """The duration that all its outages share, None without outages or where they differ."""
        durations = {duration for _, duration in self.outages}
        return durations.pop() if len(durations) == 1 else None

    def order(self) -> tuple[float, tuple[tuple[int, float], ...], tuple[int, int]]:
        """Return the sort key."""
        return self.duration_days or 0.0, self.outages, strategy_key(self.strategy)


def _table(k: int, cases: Sequence[_Case]) -> Table:
    rows = tuple(_row(case) for case in cases)
    n = len({case.outages for case in cases})
    caption = (
        f"{n} {'case' if n == 1 else 'cases'}. Intervals of ratios are Wilson's, 95 %, and those of "
        "times follow from them. All mappings together. Delta-v is that of the transfer, of strict solutions."
    )
    return Table(f"cases-p{k}", f"Cases of P_{k}", caption, COLUMNS, rows)


def _row(case: _Case) -> tuple[Cell, ...]:
    tally = case.tally
    return (
        case_name(case.outages).replace("-", ", ") or "none",
        case.duration_days,
        case.strategy,
        *(tally.n_solves, tally.n_paper, percent(tally.paper_ratio)),
        *(tally.n_strict, percent(tally.strict_ratio)),
        seconds_per_solution(tally.core_hours, tally.n_solves, tally.strict_ratio),
        *(number(tally.delta_v_km_s.least), number(tally.delta_v_km_s.median)),
        number(tally.propellant_kg.least),
    )
