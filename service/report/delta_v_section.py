"""What solutions cost: delta-v by strategy and duration, and against their own seeds."""

from collections.abc import Sequence
from dataclasses import replace

from core.analysis.campaign_statistics import Summary, solutions
from core.analysis.comparison import PairedChange, paired_change
from core.analysis.paper_values import paper_value
from service.report.boxes_plot import LEAST_FOR_BOX, Sample, boxes
from service.report.cells import READ, Cell, Column, Table
from service.report.estimates import duration_label, mean_of, number, percent, strategy_key
from service.report.groups import Groups, Key
from service.report.page import Picture, Section

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
