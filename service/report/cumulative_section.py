"""What a solution costs together with its seeds: by the paper's definition and by the consistent one."""

from collections.abc import Sequence
from dataclasses import replace

from core.analysis.cumulative_cost import Cumulative, seed_chains
from core.analysis.metrics import Estimate
from core.analysis.paper_values import PaperValue, paper_value
from service.report.cells import AS_GIVEN, DERIVED, READ, Cell, Column, Table
from service.report.estimates import duration_label, in_seconds, percent, strategy_key
from service.report.groups import Groups, labelled
from service.report.page import Picture, Section
from service.report.rows_plot import Row, Series, forest
from service.report.style import BLUE, GREEN, ORANGE

COLUMNS = (
    Column("seed chain", "seed_chain"),
    Column("search", "search"),
    Column("outage, days", "duration_days", 1),
    Column("ratio, %", "ratio_percent"),
    Column("core-s, added", "core_seconds_added"),
    Column("core-s, full", "core_seconds_full"),
    Column("core-s, seeds shared", "core_seconds_shared"),
    Column("ratio, %", "published_ratio_percent", source=DERIVED),
    Column("core-h, added", "published_hours_added", AS_GIVEN, READ),
    Column("core-h, full", "published_hours_full", source=DERIVED),
)
DEFINITIONS = (
    "The paper multiplies the ratios along a seed chain and adds the hours per solution. But a conditional "
    "solution needs 1/ratio solves, each with a seed of its own: the full cost counts them all. Where seeds "
    "serve several cases or mappings, each can be paid once: seeds shared."
)


def cumulative_section(groups: Groups) -> Section:
    """Return the table and the figures of seed chains, nothing where no search has seeds."""
    by = ("search", "duration_days", "mapping")
    chains = sorted(
        (_labelled(one) for one in seed_chains(groups.findings, "paper", by=by)),
        key=lambda one: (*strategy_key(one.strategy), one.chain),
    )
    return Section(
        "cumulative",
        "With the seeds' cost",
        (DEFINITIONS,),
        (_table(chains),),
        (_ratios(chains), _times(chains)),
    )


def _labelled(one: Cumulative) -> Cumulative:
    """Return a chain whose last strategy names its mapping, where that is not the paper's."""
    label = labelled(one.strategy, one.mapping)
    return replace(one, strategy=label, chain=label + one.chain.removeprefix(one.strategy))


def _paper(one: Cumulative) -> PaperValue | None:
    return paper_value(one.strategy, one.duration_days or 0.0)


def _table(chains: Sequence[Cumulative]) -> Table:
    rows = []
    for one in chains:
        ours: tuple[Cell, ...] = (one.chain.replace("<-", "←"), one.search, one.duration_days or None)
        costs = (in_seconds(one.hours), in_seconds(one.full_hours), in_seconds(one.shared_hours))
        rows.append((*ours, percent(one.ratio), *costs, *_paper_cells(_paper(one))))
    caption = (
        "Each search at the paper's tolerance, the searches that its seeds come from at the one at which it "
        "takes seeds; CPU time per solution. "
        "Intervals, 95 %, combine the Wilson intervals of the ratios along the seed chain."
    )
    return Table("cumulative", "Seed chains", caption, COLUMNS, tuple(rows))


def _paper_cells(paper: PaperValue | None) -> tuple[Cell, ...]:
    if paper is None:
        return (None,) * 3
    added = paper.cumulative_hours.value if paper.cumulative_hours else None
    return percent(paper.cumulative_ratio), added, paper.full_hours


def _label(one: Cumulative) -> str:
    return one.chain.replace(" <- ", "←")


def _ratios(chains: Sequence[Cumulative]) -> Picture:
    series = (Series("ours", BLUE), Series("paper", ORANGE, "D", is_filled=False))
    rows = [
        Row(
            _label(one),
            duration_label(one.duration_days),
            (percent(one.ratio), None if (paper := _paper(one)) is None else percent(paper.cumulative_ratio)),
        )
        for one in chains
    ]
    caption = (
        f"Product of the ratios along a seed chain, {len(chains)} searches and durations, at the paper's "
        "tolerance, logarithmic. Intervals, 95 %, combine the Wilson intervals of the ratios. The paper's "
        "are computed from its counts."
    )
    figure = forest(rows, series, "product of the ratios, %", is_time=False)
    return Picture("cumulative-ratio", "Cumulative ratio", caption, figure)


def _times(chains: Sequence[Cumulative]) -> Picture:
    series = (
        Series("ours, added", BLUE),
        Series("ours, full", GREEN, "s"),
        Series("paper, added", ORANGE, "D", is_filled=False),
        Series("paper, full", ORANGE, "s", is_filled=False),
    )
    rows = [
        Row(_label(one), duration_label(one.duration_days), (*_seconds(one), *_seconds(_paper(one))))
        for one in chains
    ]
    caption = (
        f"Core-time per solution along a seed chain, {len(chains)} searches and durations, at the paper's "
        "tolerance, logarithmic: hours per solution added as in the paper's figure 17, and in full, with "
        "1/ratio seeds per solution. Intervals, 95 %, combine the Wilson intervals of the ratios. The "
        "paper's are computed from its counts."
    )
    figure = forest(rows, series, "core-time per solution", is_time=True)
    return Picture("cumulative-time", "Cumulative time", caption, figure)


def _seconds(one: Cumulative | PaperValue | None) -> tuple[Estimate | None, Estimate | None]:
    if one is None:
        return None, None
    added = one.hours if isinstance(one, Cumulative) else one.summed_hours
    return in_seconds(added), in_seconds(one.full_hours)
