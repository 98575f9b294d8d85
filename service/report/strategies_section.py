"""How often strategies succeed, and what a solution costs: ours beside the paper's."""

from collections.abc import Sequence

from core.analysis.campaign_statistics import SeedYield, Summary, seed_yields
from core.analysis.metrics import Estimate
from core.analysis.paper_values import PaperValue, paper_value
from service.report.cells import AS_GIVEN, DERIVED, SOURCES, Cell, Column, Table
from service.report.estimates import (
    SECONDS_PER_HOUR,
    duration_label,
    number,
    percent,
    seconds_per_solution,
)
from service.report.groups import Groups
from service.report.page import Picture, Section
from service.report.rows_plot import Row, Series, forest
from service.report.style import BLUE, GREEN, ORANGE

INTERVALS = "Intervals are Wilson's, 95 %."
OPEN = "A line without a mark: no solution so far."


def strategies_section(groups: Groups) -> Section:
    """Return the tables and figures of ratios and times."""
    found = list(groups.summaries.values())
    drawn = [one for one in found if "|" not in (one.strategy or "")]
    seeded = [one for one in found if "|" in (one.strategy or "")]
    tables = []
    if drawn:
        tables += [_ratio_table(drawn, "non-conditional"), _cost_table(drawn, "non-conditional")]
    if seeded:
        tables += [_ratio_table(seeded, "conditional"), _cost_table(seeded, "conditional")]
        tables.append(_yields(seed_yields(groups.findings.facts.solves)))
    return Section(
        "strategies",
        "Feasibility and time",
        (
            "Every solve started counts as a guess, failures included. The paper's tolerance is 1 km, 100 "
            "m/s and 1 kg, the strict one 0.1 km, 0.1 m/s and 10 g; both are judged by a second, "
            "independent flight.",
        ),
        tuple(tables),
        (_ratios(found), _times(found)),
    )


#: What the two kinds of strategies are called, and where the paper has them.
KINDS = {
    "non-conditional": ("Non-conditional: guesses are drawn", "Table 8", "Table 8"),
    "conditional": ("Conditional: guesses are mapped from seeds", "figure 14", "figure 15"),
}


def _ratio_table(groups: Sequence[Summary], kind: str) -> Table:
    title, source, _ = KINDS[kind]
    papers = [paper_of(one) for one in groups]
    known = next((paper for paper in papers if paper is not None), None)
    columns = (
        Column("strategy", "strategy"),
        Column("outage, days", "duration_days", 1),
        Column("cases", "n_cases"),
        Column("solves", "n_solves"),
        Column("solutions, strict", "n_strict"),
        Column("ratio, %, strict", "strict_ratio_percent"),
        Column("solutions, paper's tolerance", "n_paper"),
        Column("ratio, %, paper's tolerance", "paper_ratio_percent"),
        Column("ratio, %", "published_ratio_percent", AS_GIVEN, SOURCES[known.ratio.mark] if known else None),
        Column(
            "solutions", "published_n_solutions", None, SOURCES[known.n_solutions_mark] if known else None
        ),
        Column("solves", "published_n_solves", None, DERIVED),
    )
    rows = tuple(
        (*_ratio_cells(one), *_paper_cells(paper)) for one, paper in zip(groups, papers, strict=True)
    )
    caption = (
        f"Ours beside the paper's {source}, all its cases together. {INTERVALS} The paper prints no "
        "numbers of guesses: these reproduce all its digits, and its intervals are computed from them."
    )
    n_shown = len(columns) if known else len(columns) - 3
    return Table(kind, title, caption, columns[:n_shown], tuple(row[:n_shown] for row in rows))


def _ratio_cells(one: Summary) -> tuple[Cell, ...]:
    return (
        one.strategy,
        one.duration_days or None,
        *(one.n_cases, one.n_solves),
        *(one.n_strict, percent(one.strict_ratio)),
        *(one.n_paper, percent(one.paper_ratio)),
    )


def _paper_cells(paper: PaperValue | None) -> tuple[Cell, ...]:
    if paper is None:
        return (None,) * 3
    return _paper_percent(paper), paper.n_solutions, paper.n_guesses


def _cost_table(groups: Sequence[Summary], kind: str) -> Table:
    _, _, source = KINDS[kind]
    papers = [paper_of(one) for one in groups]
    known = next((paper for paper in papers if paper is not None), None)
    columns = (
        Column("strategy", "strategy"),
        Column("outage, days", "duration_days", 1),
        Column("distinct solutions", "n_distinct"),
        Column("distinct per core-hour", "distinct_per_core_hour"),
        Column("core-s per strict solution", "core_seconds_per_strict"),
        Column("core-s at the cap, same", "cap_seconds_per_strict"),
        Column("core-s per solution, paper's tolerance", "core_seconds_per_paper"),
        Column("h by the paper's charge, same", "charged_hours_per_paper"),
        Column("h", "published_hours", AS_GIVEN, SOURCES[known.hours_per_solution.mark] if known else None),
    )
    rows = tuple(
        (*_cost_cells(one), None if paper is None else paper.hours_per_solution.value)
        for one, paper in zip(groups, papers, strict=True)
    )
    caption = (
        "Core-seconds are the CPU time of all solves, failures included; at the cap, what they were "
        f"allowed; the paper's charge is 0.5 h (1 + k) per guess, whatever was used, as in its {source}. "
        "Intervals follow from those of the ratios. Distinct: strict solutions whose references differ, "
        "counted within each case."
    )
    n_shown = len(columns) if known else len(columns) - 1
    shown = tuple(row[:n_shown] for row in rows)
    return Table(f"{kind}-cost", "What a solution costs", caption, columns[:n_shown], shown)


def _cost_cells(one: Summary) -> tuple[Cell, ...]:
    return (
        one.strategy,
        one.duration_days or None,
        *(one.n_distinct, number(one.distinct_per_core_hour)),
        seconds_per_solution(one.cost.core_hours, one.n_solves, one.strict_ratio),
        number(one.cost_per_strict.cap_hours * SECONDS_PER_HOUR),
        seconds_per_solution(one.cost.core_hours, one.n_solves, one.paper_ratio),
        number(one.cost_per_paper.charged_hours),
    )


def paper_of(one: Summary) -> PaperValue | None:
    """Return what the paper has for a group, if anything."""
    return None if one.strategy is None else paper_value(one.strategy, one.duration_days or 0.0)


def _paper_percent(paper: PaperValue) -> Estimate:
    _, low, high = paper.ratio_interval
    return Estimate(round(100.0 * paper.ratio.value, 6), 100.0 * low, 100.0 * high)


def _yields(found: Sequence[SeedYield]) -> Table:
    columns = (
        Column("seeds from", "seeds_of"),
        Column("target", "target"),
        Column("seeds used", "n_seeds"),
        Column("solves", "n_solves"),
        Column("solutions, strict", "n_strict"),
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
    caption = f"Which seeds give which problem: all durations and mappings together. {INTERVALS}"
    return Table("seed-yields", "Seeds and targets", caption, columns, rows)


SERIES = (
    Series("ours, paper's tolerance", BLUE),
    Series("ours, strict", GREEN, "s"),
    Series("paper", ORANGE, "D", is_filled=False),
)


def _ratios(groups: Sequence[Summary]) -> Picture:
    rows = []
    for one in groups:
        paper = paper_of(one)
        marks = (
            percent(one.paper_ratio),
            percent(one.strict_ratio),
            None if paper is None else _paper_percent(paper),
        )
        rows.append(Row(one.strategy or "", duration_label(one.duration_days), marks))
    caption = (
        f"Feasible solutions per solve, n = {_n(groups)} solves, by strategy and duration of the outages, "
        f"logarithmic. {INTERVALS} The paper's: S(k) as printed in its Table 8, S(k|k') read from its "
        f"figure 14. {OPEN}"
    )
    figure = forest(rows, SERIES, "feasible solves, %", is_time=False)
    return Picture("feasibility", "Feasibility ratio", caption, figure)


def _n(groups: Sequence[Summary]) -> str:
    return f"{sum(one.n_solves for one in groups):,}"


def _times(groups: Sequence[Summary]) -> Picture:
    series = (
        Series("ours, spent", BLUE),
        Series("ours, charged at the cap", GREEN, "s"),
        Series("paper, charged", ORANGE, "D", is_filled=False),
    )
    rows = []
    for one in groups:
        paper = paper_of(one)
        marks = (
            seconds_per_solution(one.cost.core_hours, one.n_solves, one.paper_ratio),
            seconds_per_solution(one.cost.cap_hours, one.n_solves, one.paper_ratio),
            None if paper is None else _paper_seconds(paper),
        )
        rows.append(Row(one.strategy or "", duration_label(one.duration_days), marks))
    caption = (
        f"Core-time per solution at the paper's tolerance, n = {_n(groups)} solves, failures included, "
        "logarithmic. Intervals follow from those of the ratios (Wilson, 95 %). The paper charges 0.5 h "
        "(1 + k) per guess, whatever was used: S(k) as printed in its Table 8, S(k|k') read from its "
        f"figure 15. {OPEN}"
    )
    figure = forest(rows, series, "core-time per solution", is_time=True)
    return Picture("time", "Time per solution", caption, figure)


def _paper_seconds(paper: PaperValue) -> Estimate:
    hours = paper.links()[-1].hours
    interval = seconds_per_solution(hours, paper.n_guesses, paper.ratio_interval)
    assert interval is not None
    return Estimate(SECONDS_PER_HOUR * paper.hours_per_solution.value, interval.low, interval.high)
