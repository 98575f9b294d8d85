"""Sections on cost: delta-v, costs with ancestor searches, and what makes the difference."""

from collections.abc import Sequence
from dataclasses import replace

from core.analysis.campaign_facts import SolveFacts
from core.analysis.campaign_statistics import Summary, grouped, solutions
from core.analysis.comparison import Comparison, PairedChange, compared, paired_change
from core.analysis.cumulative_cost import Cumulative, seed_chains
from core.analysis.metrics import Estimate
from service.report.page import Picture, Section
from service.report.paper.values import PaperValue, paper_value
from service.report.plots import (
    LEAST_FOR_BOX,
    Row,
    Sample,
    Series,
    boxes,
    duration_label,
    forest,
    in_seconds,
    mean_of,
    number,
    percent,
    seconds_per_solution,
    strategy_key,
)
from service.report.strategies import Groups, Key, Tally, labelled, tally_of
from service.report.style import BLUE, GREEN, ORANGE
from service.report.tables import AS_GIVEN, DERIVED, READ, Cell, Column, Table

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


TUKEY = (
    "Boxes hold the middle half, whiskers reach to the last value within 1.5 times its width, points lie "
    f"beyond; fewer than {LEAST_FOR_BOX} values are shown as they are."
)


def delta_v_section(groups: Groups) -> Section:
    """Return means, and box plots for each number of outages that has solutions."""
    found = list(groups.summaries.values())
    robust = sorted({strategy_key(one.strategy or "")[0] for one in found if one.n_strict} - {0})
    return Section(
        "delta-v",
        "Delta-v",
        (
            "Delta-v in total includes the spiral, as in the paper: 3.252 km/s there, 3.242 km/s with the "
            "flagship's departure here. Only strict solutions count.",
        ),
        (_means(found),),
        tuple(_boxes(groups, k) for k in robust),
    )


def _means(groups: Sequence[Summary]) -> Table:
    columns = (
        Column("strategy", "strategy"),
        Column("outage, days", "duration_days", 1),
        Column("solutions, strict", "n_strict"),
        Column("least, transfer, km/s", "least_delta_v_km_s", 3),
        Column("median, transfer, km/s", "median_delta_v_km_s", 3),
        Column("mean, transfer, km/s", "mean_delta_v_km_s", 3),
        Column("mean, total, km/s", "mean_delta_v_total_km_s", 3),
        Column("least propellant, kg", "least_propellant_kg", 1),
        Column("mean, total, km/s", "published_mean_delta_v_total_km_s", 3, READ),
    )
    rows: list[tuple[Cell, ...]] = []
    for one in groups:
        paper = paper_value(one.strategy or "", one.duration_days or 0.0)
        rows.append(
            (
                one.strategy,
                one.duration_days or None,
                one.n_strict,
                number(one.delta_v_km_s.least),
                number(one.delta_v_km_s.median),
                mean_of(one.delta_v_km_s),
                mean_of(one.delta_v_total_km_s),
                number(one.propellant_kg.least),
                None if paper is None else paper.mean_delta_v_total_km_s.value,
            )
        )
    caption = (
        "Strict solutions. Intervals of means are Student's, 95 %. The paper's means are read from its "
        "figures 10 to 13, to 0.003 km/s, and hold solutions at its own tolerance."
    )
    return Table("delta-v", "Means and extremes", caption, columns, tuple(rows))


def _boxes(groups: Groups, k: int) -> Picture:
    samples = []
    for (strategy, days), solves in groups.solves.items():
        if strategy_key(strategy)[0] not in (0, k):
            continue
        found = solutions(solves, "strict")
        values = tuple(one.delta_v_total_km_s for one in found if one.delta_v_total_km_s is not None)
        paper = paper_value(strategy, days or 0.0)
        mean = None if paper is None else paper.mean_delta_v_total_km_s.value
        samples.append(Sample(strategy, duration_label(days), values, mean))
    n = sum(len(sample.values) for sample in samples)
    caption = (
        f"Total delta-v of strict solutions of P_{k} by strategy and duration of the outages, S(0) above "
        f"them where there is one, n = {n:,}. {TUKEY} The paper's means are read from its figures 10 to 13."
    )
    figure = boxes(samples, "delta-v with the spiral, km/s", resolution=0.002)
    return Picture(f"delta-v-p{k}", f"Delta-v for P_{k}", caption, figure)


def changes_section(groups: Groups) -> Section | None:
    """Return the change of propellant from seed to solution, None where no search has seeds."""
    changes = {
        key: replace(paired_change(groups.findings, solves), strategy=key[0])
        for key, solves in groups.solves.items()
        if any(one.seed_id is not None for one in solves)
    }
    if not changes:
        return None
    return Section(
        "changes",
        "From seed to solution",
        (
            "Each solution is paired with its own seed. More constraints cannot lower an optimum: where a "
            "solution is cheaper than its seed, the seed was not optimal.",
        ),
        (_changes_table(list(changes.values())),),
        (_changes_picture(groups, list(changes)),),
    )


def _changes_table(changes: Sequence[PairedChange]) -> Table:
    columns = (
        Column("strategy", "strategy"),
        Column("outage, days", "duration_days", 1),
        Column("pairs", "n_pairs"),
        Column("seeds", "n_seeds"),
        Column("mean change, kg", "mean_change_kg", 2),
        Column("median, kg", "median_change_kg", 2),
        Column("quarter, kg", "lower_quartile_kg", 2),
        Column("three quarters, kg", "upper_quartile_kg", 2),
        Column("cheaper than the seed, %", "cheaper_percent"),
        Column("p, signed ranks", "wilcoxon_p", 4, is_p=True),
    )
    rows = tuple(
        (
            one.strategy,
            one.duration_days or None,
            *(one.propellant_kg.n, one.n_seeds, mean_of(one.propellant_kg)),
            *(number(one.propellant_kg.median), number(one.propellant_kg.lower_quartile)),
            number(one.propellant_kg.upper_quartile),
            percent(one.cheaper),
            number(one.wilcoxon_p),
        )
        for one in changes
    )
    caption = (
        "Propellant of the solution minus that of its seed, strict solutions. The interval of a mean is "
        "Student's, that of a share Wilson's, both 95 %; the test is Wilcoxon's, two-sided, with one "
        "number per seed. A change of 0.01 kg or less counts as none in the last two columns."
    )
    return Table("paired-changes", "Paired change of propellant", caption, columns, rows)


def _changes_picture(groups: Groups, keys: Sequence[Key]) -> Picture:
    samples = []
    for strategy, days in keys:
        pairs = [
            one.propellant_kg - seed.propellant_kg
            for one in solutions(groups.solves[strategy, days], "strict")
            if (seed := groups.findings.found_by.get(one.seed_id or ""))
            and one.propellant_kg is not None
            and seed.propellant_kg is not None
        ]
        samples.append(Sample(strategy, duration_label(days), tuple(pairs)))
    n = sum(len(sample.values) for sample in samples)
    caption = (
        f"Propellant of each strict solution minus that of its seed, n = {n:,} pairs. {TUKEY} The paper "
        "does not pair its solutions."
    )
    figure = boxes(samples, "change of propellant, kg", resolution=0.5, zero_line=True)
    return Picture("paired-changes", "Change of propellant", caption, figure)


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
