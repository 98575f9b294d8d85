"""What makes the difference: mappings as a factor of their own, and strategies against each other."""

from collections.abc import Sequence

from core.analysis.campaign_statistics import SolveFacts, grouped
from core.analysis.comparison import Comparison, compared
from service.report.cells import Cell, Column, Table
from service.report.estimates import (
    duration_label,
    mean_of,
    number,
    percent,
    seconds_per_solution,
    strategy_key,
)
from service.report.groups import Groups, Tally, tally_of
from service.report.page import Picture, Section
from service.report.rows_plot import Row, Series, forest
from service.report.style import BLUE, GREEN

BY_MAPPING = ("strategy", "mapping")


def mappings_section(groups: Groups) -> Section | None:
    """Return the comparison of mappings, None where no search has seeds."""
    by_strategy: dict[str, dict[str, Sequence[SolveFacts]]] = {}
    seeded = (one for one in groups.findings.facts.solves if one.mapping is not None)
    for (strategy, mapping), solves in grouped(seeded, BY_MAPPING).items():
        by_strategy.setdefault(str(strategy), {})[str(mapping)] = solves
    if not by_strategy:
        return None
    found = [
        (strategy, mapping, tally_of(by_strategy[strategy][mapping]))
        for strategy in sorted(by_strategy, key=strategy_key)
        for mapping in sorted(by_strategy[strategy])
    ]
    tests = [
        (strategy, one)
        for strategy, mappings in by_strategy.items()
        if len(mappings) > 1
        for one in compared(mappings)
    ]
    tables = [_mappings(found)]
    if tests:
        title = "Mappings against each other"
        tables.append(_tests("mapping-tests", title, "One family of tests for each strategy.", tests))
    paragraph = (
        "The same seeds, made into guesses by different rules: all durations together. The paper uses the "
        "mapping called reference alone."
    )
    return Section("mappings", "Mappings", (paragraph,), tuple(tables), (_picture(found),))


def _mappings(groups: Sequence[tuple[str, str, Tally]]) -> Table:
    columns = (
        Column("strategy", "strategy"),
        Column("mapping", "mapping"),
        Column("solves", "n_solves"),
        Column("ratio, %", "paper_ratio_percent"),
        Column("ratio, %, strict", "strict_ratio_percent"),
        Column("core-s per strict solution", "core_seconds_per_strict"),
        Column("mean delta-v, transfer, km/s", "mean_delta_v_km_s", 3),
    )
    rows = tuple(
        (
            *(strategy, mapping, one.n_solves),
            *(percent(one.paper_ratio), percent(one.strict_ratio)),
            seconds_per_solution(one.core_hours, one.n_solves, one.strict_ratio),
            mean_of(one.delta_v_km_s),
        )
        for strategy, mapping, one in groups
    )
    caption = (
        "All durations together. Intervals of ratios are Wilson's, those of means Student's, both 95 %. A "
        "number in brackets after a mapping names the realization of the seed that each realization "
        "starts from."
    )
    return Table("mappings", "Mappings by strategy", caption, columns, rows)


def _picture(groups: Sequence[tuple[str, str, Tally]]) -> Picture:
    series = (Series("paper's tolerance", BLUE), Series("strict", GREEN, "s"))
    rows = [
        Row(strategy, mapping, (percent(one.paper_ratio), percent(one.strict_ratio)))
        for strategy, mapping, one in groups
    ]
    n = sum(one.n_solves for _, _, one in groups)
    caption = (
        f"Feasible solutions per solve by strategy and mapping, all durations together, n = {n:,} solves, "
        "logarithmic. Intervals are Wilson's, 95 %. A line without a mark: no solution so far."
    )
    return Picture(
        "mappings", "Ratio by mapping", caption, forest(rows, series, "feasible solves, %", is_time=False)
    )


def comparisons_section(groups: Groups) -> Section | None:
    """Return tests between strategies for the same outages, None where there is nothing to compare."""
    families: dict[tuple[int, float | None], dict[str, Sequence[SolveFacts]]] = {}
    for (strategy, days), solves in groups.solves.items():
        families.setdefault((solves[0].k, days), {})[strategy] = solves
    tests = [
        (duration_label(days), one)
        for (_, days), family in sorted(families.items(), key=lambda entry: (entry[0][0], entry[0][1] or 0.0))
        if len(family) > 1
        for one in compared(family)
    ]
    if not tests:
        return None
    title = "Strategies for the same number and duration of outages"
    caption = "One family of tests for each number and duration of outages."
    table = _tests("strategy-tests", title, caption, tests, "outage")
    paragraph = (
        "A small p says that chance alone would hardly make such a difference, not that the difference "
        "matters; the numbers of solves and solutions stand beside it."
    )
    return Section("comparisons", "Strategies against each other", (paragraph,), (table,))


def _tests(
    name: str, title: str, family: str, tests: Sequence[tuple[str, Comparison]], context: str = "strategy"
) -> Table:
    columns = (
        Column(context, context),
        Column("one", "one"),
        Column("other", "other"),
        Column("solutions, one", "n_solutions_one"),
        Column("solves, one", "n_solves_one"),
        Column("solutions, other", "n_solutions_other"),
        Column("solves, other", "n_solves_other"),
        Column("p of the ratios", "fisher_p", 4, is_p=True),
        Column("corrected", "fisher_holm_p", 4, is_p=True),
        Column("median difference, km/s", "median_difference_km_s", 3),
        Column("chance that one is dearer", "dearer", 2),
        Column("p of the delta-v", "mann_whitney_p", 4, is_p=True),
        Column("corrected", "mann_whitney_holm_p", 4, is_p=True),
    )
    caption = (
        f"{family} Strict solutions; ratios by Fisher's exact test, delta-v of the transfer by Mann and "
        "Whitney's, two-sided; corrected as Holm does for the whole family."
    )
    rows = tuple((words, *_test_cells(one)) for words, one in tests)
    return Table(name, title, caption, columns, rows)


def _test_cells(one: Comparison) -> tuple[Cell, ...]:
    return (
        *(one.one, one.other),
        *(one.n_solutions_one, one.n_solves_one),
        *(one.n_solutions_other, one.n_solves_other),
        *(number(one.fisher_p), number(one.fisher_holm_p)),
        *(number(one.median_difference_km_s), number(one.dearer)),
        *(number(one.mann_whitney_p), number(one.mann_whitney_holm_p)),
    )
