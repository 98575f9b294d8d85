"""Sections on cost: delta-v, costs including ancestor searches, and comparisons."""

from collections.abc import Sequence
from dataclasses import replace

from core.analysis.campaign_facts import SolveFacts
from core.analysis.campaign_statistics import Summary, group_solves, solutions
from core.analysis.comparison import Comparison, PairedChange, compare_groups, paired_change
from core.analysis.cumulative_cost import Cumulative, seed_chains
from service.report.page import Picture, Section
from service.report.plots import (
    LEAST_FOR_BOX,
    Chart,
    Row,
    Sample,
    Series,
    boxes,
    duration_label,
    in_seconds,
    mean_of,
    number,
    percent,
    seconds_per_solution,
    strategy_key,
)
from service.report.strategies import Counts, Groups, Key, counts_of, label_of
from service.report.style import BLUE, GREEN
from service.report.tables import Cell, Column, Table

COLUMNS = (
    Column("seed chain", "seed_chain"),
    Column("search", "search"),
    Column("outage, days", "duration_days", 1),
    Column("ratio, %", "ratio_percent"),
    Column("core-s, added", "core_seconds_added"),
    Column("core-s, full", "core_seconds_full"),
    Column("core-s, seeds shared", "core_seconds_shared"),
)
DEFINITIONS = (
    "Added: the ratios along a seed chain multiplied, the hours per solution summed. But a conditional "
    "solution needs 1/ratio solves, each with a seed of its own: the full cost counts them all. Where seeds "
    "serve several cases or mappings, each can be paid once: seeds shared."
)


def cumulative_section(groups: Groups) -> Section:
    """Return the table and the figures of seed chains."""
    by = ("search", "duration_days", "mapping")
    chains = sorted(
        (_with_label(one) for one in seed_chains(groups.findings, "paper", by=by)),
        key=lambda one: (*strategy_key(one.strategy), one.chain),
    )
    beside = groups.beside
    charts = (_ratios(chains), _times(chains))
    return Section(
        "cumulative",
        "With the seeds' cost",
        (DEFINITIONS + beside.sentence("cumulative"),),
        (beside.join_table(_table(chains), chains),),
        tuple(beside.join_chart(chart, chains).picture() for chart in charts),
    )


def _with_label(one: Cumulative) -> Cumulative:
    """Return a chain whose last strategy names its mapping, where that is not the default."""
    label = label_of(one.strategy, one.mapping)
    return replace(one, strategy=label, chain=label + one.chain.removeprefix(one.strategy))


def _table(chains: Sequence[Cumulative]) -> Table:
    rows = []
    for one in chains:
        head: tuple[Cell, ...] = (one.chain.replace("<-", "←"), one.search, one.duration_days or None)
        costs = (in_seconds(one.hours), in_seconds(one.full_hours), in_seconds(one.shared_hours))
        rows.append((*head, percent(one.ratio), *costs))
    caption = (
        "Each search at the loose tolerance, the searches that its seeds come from at the one at which it "
        "takes seeds; CPU time per solution. "
        "Intervals, 95 %, combine the Wilson intervals of the ratios along the seed chain."
    )
    return Table("cumulative", "Seed chains", caption, COLUMNS, tuple(rows))


def _label(one: Cumulative) -> str:
    return one.chain.replace(" <- ", "←")


def _ratios(chains: Sequence[Cumulative]) -> Chart:
    rows = [Row(_label(one), duration_label(one.duration_days), (percent(one.ratio),)) for one in chains]
    caption = (
        f"Product of the ratios along a seed chain, {len(chains)} searches and durations, at the loose "
        "tolerance, logarithmic. Intervals, 95 %, combine the Wilson intervals of the ratios."
    )
    series = (Series("this campaign", BLUE),)
    label = "product of the ratios, %"
    return Chart("cumulative-ratio", "Cumulative ratio", caption, label, series, rows)


def _times(chains: Sequence[Cumulative]) -> Chart:
    series = (Series("added", BLUE), Series("full", GREEN, "s"))
    rows = [
        Row(
            _label(one),
            duration_label(one.duration_days),
            (in_seconds(one.hours), in_seconds(one.full_hours)),
        )
        for one in chains
    ]
    caption = (
        f"Core-time per solution along a seed chain, {len(chains)} searches and durations, at the loose "
        "tolerance, logarithmic: hours per solution added, and in full, with 1/ratio seeds per solution. "
        "Intervals, 95 %, combine the Wilson intervals of the ratios."
    )
    label = "core-time per solution"
    return Chart("cumulative-time", "Cumulative time", caption, label, series, rows, is_time=True)


TUKEY = (
    "Boxes hold the middle half, whiskers reach to the last value within 1.5 times its width, points lie "
    f"beyond; fewer than {LEAST_FOR_BOX} values are drawn as points."
)


def delta_v_section(groups: Groups) -> Section:
    """Return means, and box plots for each number of outages that has solutions."""
    found = list(groups.summaries.values())
    robust = sorted({strategy_key(one.strategy or "")[0] for one in found if one.n_strict} - {0})
    paragraph = (
        "Delta-v in total is counted from the wet mass, and so includes a spiral before the departure. Only "
        "strict solutions count."
    )
    return Section(
        "delta-v",
        "Delta-v",
        (paragraph + groups.beside.sentence("delta-v"),),
        (groups.beside.join_table(_means(found), found),),
        tuple(_boxes(groups, k) for k in robust),
    )


def _means(groups: Sequence[Summary]) -> Table:
    columns = (
        Column("strategy", "strategy"),
        Column("outage, days", "duration_days", 1),
        Column("strict solutions", "n_strict"),
        Column("least, transfer, km/s", "least_delta_v_km_s", 3),
        Column("median, transfer, km/s", "median_delta_v_km_s", 3),
        Column("mean, transfer, km/s", "mean_delta_v_km_s", 3),
        Column("mean, total, km/s", "mean_delta_v_total_km_s", 3),
        Column("least propellant, kg", "least_propellant_kg", 1),
    )
    rows = tuple(
        (
            one.strategy,
            one.duration_days or None,
            one.n_strict,
            *(number(one.delta_v_km_s.least), number(one.delta_v_km_s.median)),
            *(mean_of(one.delta_v_km_s), mean_of(one.delta_v_total_km_s)),
            number(one.propellant_kg.least),
        )
        for one in groups
    )
    caption = "Strict solutions. Intervals of means are Student's, 95 %."
    return Table("delta-v", "Means and extremes", caption, columns, rows)


def _boxes(groups: Groups, k: int) -> Picture:
    shown = [key for key in groups.solves if strategy_key(key[0])[0] in (0, k)]
    samples = []
    for key in shown:
        found = solutions(groups.solves[key], "strict")
        values = tuple(one.delta_v_total_km_s for one in found if one.delta_v_total_km_s is not None)
        samples.append(Sample(key[0], duration_label(key[1]), values))
    n = sum(len(sample.values) for sample in samples)
    caption = (
        f"Total delta-v of strict solutions of P_{k} by strategy and duration of the outages, S(0) above "
        f"them where there is one, n = {n:,}. {TUKEY}{groups.beside.sentence('delta-v-boxes')}"
    )
    beside = groups.beside.join_samples(samples, [groups.summaries[key] for key in shown])
    figure = boxes(beside, "total delta-v, km/s", resolution=0.002)
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
        f"Propellant of each strict solution minus that of its seed, n = {n:,} pairs. "
        f"{TUKEY}{groups.beside.sentence('changes')}"
    )
    figure = boxes(samples, "change of propellant, kg", resolution=0.5, zero_line=True)
    return Picture("paired-changes", "Change of propellant", caption, figure)


BY_MAPPING = ("strategy", "mapping")


def mappings_section(groups: Groups) -> Section | None:
    """Return the comparison of mappings, None where no search has seeds."""
    by_strategy: dict[str, dict[str, Sequence[SolveFacts]]] = {}
    seeded = (one for one in groups.findings.facts.solves if one.mapping is not None)
    for (strategy, mapping), solves in group_solves(seeded, BY_MAPPING).items():
        by_strategy.setdefault(str(strategy), {})[str(mapping)] = solves
    if not by_strategy:
        return None
    found = [
        (strategy, mapping, counts_of(by_strategy[strategy][mapping]))
        for strategy in sorted(by_strategy, key=strategy_key)
        for mapping in sorted(by_strategy[strategy])
    ]
    tests = [
        (strategy, one)
        for strategy, mappings in by_strategy.items()
        if len(mappings) > 1
        for one in compare_groups(mappings)
    ]
    tables = [_mappings(found)]
    if tests:
        title = "Mappings against each other"
        tables.append(_tests("mapping-tests", title, "One family of tests for each strategy.", tests))
    paragraph = (
        "The same seeds, made into guesses by different rules: all durations together."
        + groups.beside.sentence("mappings")
    )
    return Section("mappings", "Mappings", (paragraph,), tuple(tables), (_picture(found),))


def _mappings(groups: Sequence[tuple[str, str, Counts]]) -> Table:
    columns = (
        Column("strategy", "strategy"),
        Column("mapping", "mapping"),
        Column("solves", "n_solves"),
        Column("ratio, %, loose", "paper_ratio_percent"),
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


def _picture(groups: Sequence[tuple[str, str, Counts]]) -> Picture:
    series = (Series("loose", BLUE), Series("strict", GREEN, "s"))
    rows = [
        Row(strategy, mapping, (percent(one.paper_ratio), percent(one.strict_ratio)))
        for strategy, mapping, one in groups
    ]
    n = sum(one.n_solves for _, _, one in groups)
    caption = (
        f"Feasible solutions per solve by strategy and mapping, all durations together, n = {n:,} solves, "
        "logarithmic. Intervals are Wilson's, 95 %. A line without a mark: no solution so far."
    )
    return Chart("mappings", "Ratio by mapping", caption, "feasible solves, %", series, rows).picture()


def comparisons_section(groups: Groups) -> Section | None:
    """Return tests between strategies for the same outages, None where there is nothing to compare."""
    families: dict[tuple[int, float | None], dict[str, Sequence[SolveFacts]]] = {}
    for (strategy, days), solves in groups.solves.items():
        families.setdefault((solves[0].k, days), {})[strategy] = solves
    tests = [
        (duration_label(days), one)
        for (_, days), family in sorted(families.items(), key=lambda entry: (entry[0][0], entry[0][1] or 0.0))
        if len(family) > 1
        for one in compare_groups(family)
    ]
    if not tests:
        return None
    title = "Strategies for the same number and duration of outages"
    caption = "One family of tests for each number and duration of outages."
    table = _tests("strategy-tests", title, caption, tests, "outage")
    paragraph = (
        "A small p means that so large a difference is unlikely by chance alone, not that it matters; the "
        "table also has the numbers of solves and solutions."
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
        Column("P(one costs more)", "dearer", 2),
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
