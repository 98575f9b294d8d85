"""The paper's values beside those of a campaign of the flagship, the problem that the paper solves."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from core.analysis.campaign_statistics import Summary
from core.analysis.cumulative_cost import Cumulative
from core.analysis.metrics import Estimate
from core.problem import Problem
from service.report.beside import Beside
from service.report.page import Section
from service.report.paper.structure import outages_section, sparsity_section
from service.report.paper.values import DERIVED, READ, SOURCES, PaperValue, is_flagship, paper_value
from service.report.plots import (
    SECONDS_PER_HOUR,
    Chart,
    Sample,
    Series,
    in_seconds,
    number,
    percent,
    seconds_per_solution,
)
from service.report.style import ORANGE
from service.report.tables import AS_GIVEN, Cell, Column, Table

Group = Summary | Cumulative
Papers = Sequence[PaperValue | None]
Cells = tuple[Cell, ...]


@dataclass(frozen=True, slots=True)
class TableJoin:
    """What the paper adds to one table."""

    columns: tuple[Column, ...]
    #: As many as the table has; empty where the paper adds no columns.
    rows: Sequence[Cells]
    caption: str


@dataclass(frozen=True, slots=True)
class ChartJoin:
    """What the paper adds to one forest plot."""

    series: tuple[Series, ...]
    #: One for each of the series.
    marks: Callable[[PaperValue], tuple[Estimate | None, ...]]
    caption: str


def beside_of(problem: Problem) -> Beside:
    """Return what stands beside the results of a campaign: the paper's values for the flagship alone."""
    return PaperBeside() if is_flagship(problem) else Beside()


class PaperBeside(Beside):
    """The paper's values, where it has any for a strategy and a duration."""

    source = (
        "Values of the paper are those of A. Sinha and R. Beeson, arXiv 2501.06694; those read from a figure "
        "are good to half a percent of a ratio and 0.003 km/s."
    )

    def join_table(self, table: Table, groups: Sequence[Group]) -> Table:
        """Return a table with the paper's columns at its end."""
        join = _TABLES[table.name](groups, [_paper(one) for one in groups])
        rows = join.rows or [()] * len(table.rows)
        return replace(
            table,
            columns=(*table.columns, *join.columns),
            rows=tuple((*row, *cells) for row, cells in zip(table.rows, rows, strict=True)),
            caption=f"{table.caption} {join.caption}",
        )

    def join_chart(self, chart: Chart, groups: Sequence[Group]) -> Chart:
        """Return a forest plot with the paper's series."""
        join = _CHARTS[chart.name]
        nothing = (None,) * len(join.series)
        found = [nothing if (paper := _paper(one)) is None else join.marks(paper) for one in groups]
        rows = [
            replace(row, marks=(*row.marks, *marks)) for row, marks in zip(chart.rows, found, strict=True)
        ]
        caption = f"{chart.caption} {join.caption}"
        return replace(chart, rows=rows, series=(*chart.series, *join.series), caption=caption)

    def join_samples(self, samples: Sequence[Sample], groups: Sequence[Summary]) -> Sequence[Sample]:
        """Return the samples with the paper's means."""
        return [
            sample
            if (paper := _paper(one)) is None
            else replace(sample, published_mean=paper.mean_delta_v_total_km_s.value)
            for sample, one in zip(samples, groups, strict=True)
        ]

    def sentence(self, name: str) -> str:
        """Return what is to be said of the paper in a paragraph or under a figure."""
        return f" {_SENTENCES[name]}"

    def sections(self, problem: Problem) -> tuple[Section, ...]:
        """Return the paper's figures that need no solve."""
        return sparsity_section(problem), outages_section()


_SENTENCES = MappingProxyType(
    {
        "cumulative": "The paper adds.",
        "delta-v": "The paper's spiral takes 3.252 km/s, the one of this problem 3.242 km/s.",
        "delta-v-boxes": "The paper's means are read from its figures 10 to 13.",
        "changes": "The paper does not pair its solutions.",
        "mappings": "The paper uses the mapping called reference alone.",
        "cases": "The paper gives no numbers by case.",
    }
)


def _paper(one: Group) -> PaperValue | None:
    return paper_value(one.strategy or "", one.duration_days or 0.0)


def _first(papers: Papers) -> PaperValue | None:
    return next((paper for paper in papers if paper is not None), None)


def _ratios(source: str) -> "TableJoiner":
    def join(groups: Sequence[Group], papers: Papers) -> TableJoin:
        caption = (
            f"The paper's {source} stands beside ours, all its cases together. The paper prints no numbers "
            "of guesses: these reproduce all its digits, and its intervals are computed from them."
        )
        if (known := _first(papers)) is None:
            return TableJoin((), (), caption)
        columns = (
            Column("ratio, %", "published_ratio_percent", AS_GIVEN, SOURCES[known.ratio.mark]),
            Column("solutions", "published_n_solutions", None, SOURCES[known.n_solutions_mark]),
            Column("solves", "published_n_solves", None, DERIVED),
        )
        rows = [
            (None,) * 3 if one is None else (_percent(one), one.n_solutions, one.n_guesses) for one in papers
        ]
        return TableJoin(columns, rows, caption)

    return join


def _costs(source: str) -> "TableJoiner":
    def join(groups: Sequence[Group], papers: Papers) -> TableJoin:
        caption = f"The paper's charge is 0.5 h (1 + k) per guess, whatever was used, as in its {source}."
        columns = [Column("h by the paper's charge, per loose solution", "charged_hours_per_paper")]
        rows: list[Cells] = [
            (number(one.cost_per_paper.charged_hours),) for one in groups if isinstance(one, Summary)
        ]
        if (known := _first(papers)) is not None:
            source_of = SOURCES[known.hours_per_solution.mark]
            columns.append(Column("h", "published_hours", AS_GIVEN, source_of))
            hours = [None if one is None else one.hours_per_solution.value for one in papers]
            rows = [(*row, value) for row, value in zip(rows, hours, strict=True)]
        return TableJoin(tuple(columns), rows, caption)

    return join


def _means(groups: Sequence[Group], papers: Papers) -> TableJoin:
    return TableJoin(
        (Column("mean, total, km/s", "published_mean_delta_v_total_km_s", 3, READ),),
        [(None if one is None else one.mean_delta_v_total_km_s.value,) for one in papers],
        "The paper's means are read from its figures 10 to 13, to 0.003 km/s, and hold loose solutions.",
    )


def _chains(groups: Sequence[Group], papers: Papers) -> TableJoin:
    columns = (
        Column("ratio, %", "published_ratio_percent", source=DERIVED),
        Column("core-h, added", "published_hours_added", AS_GIVEN, READ),
        Column("core-h, full", "published_hours_full", source=DERIVED),
    )
    rows: list[Cells] = []
    for one in papers:
        if one is None:
            rows.append((None,) * 3)
            continue
        added = one.cumulative_hours.value if one.cumulative_hours else None
        rows.append((percent(one.cumulative_ratio), added, one.full_hours))
    return TableJoin(columns, rows, "The paper's ratios and full costs are computed from its counts.")


TableJoiner = Callable[[Sequence[Group], Papers], TableJoin]
_TABLES: Mapping[str, TableJoiner] = MappingProxyType(
    {
        "non-conditional": _ratios("Table 8"),
        "conditional": _ratios("figure 14"),
        "non-conditional-cost": _costs("Table 8"),
        "conditional-cost": _costs("figure 15"),
        "cumulative": _chains,
        "delta-v": _means,
    }
)


def _percent(paper: PaperValue) -> Estimate:
    _, low, high = paper.ratio_interval
    return Estimate(round(100.0 * paper.ratio.value, 6), 100.0 * low, 100.0 * high)


def _seconds(paper: PaperValue) -> Estimate:
    hours = paper.links()[-1].hours
    interval = seconds_per_solution(hours, paper.n_guesses, paper.ratio_interval)
    assert interval is not None
    return Estimate(SECONDS_PER_HOUR * paper.hours_per_solution.value, interval.low, interval.high)


def _series(name: str, marker: str = "D") -> Series:
    return Series(name, ORANGE, marker, is_filled=False)


_CHARTS: Mapping[str, ChartJoin] = MappingProxyType(
    {
        "feasibility": ChartJoin(
            (_series("paper"),),
            lambda paper: (_percent(paper),),
            "The paper's: S(k) as printed in its Table 8, S(k|k') read from its figure 14.",
        ),
        "time": ChartJoin(
            (_series("paper, charged"),),
            lambda paper: (_seconds(paper),),
            "The paper charges 0.5 h (1 + k) per guess, whatever was used: S(k) as printed in its Table 8, "
            "S(k|k') read from its figure 15.",
        ),
        "cumulative-ratio": ChartJoin(
            (_series("paper"),),
            lambda paper: (percent(paper.cumulative_ratio),),
            "The paper's are computed from its counts.",
        ),
        "cumulative-time": ChartJoin(
            (_series("paper, added"), _series("paper, full", "s")),
            lambda paper: (in_seconds(paper.summed_hours), in_seconds(paper.full_hours)),
            "Hours are added as in the paper's figure 17; the paper's are computed from its counts.",
        ),
    }
)
