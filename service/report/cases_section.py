"""Every case on its own: one table for each number of outages."""

from collections.abc import Sequence

from core.analysis.study import Summary, summaries
from service.report.cells import Column, Table
from service.report.estimates import number, percent, seconds_per_solution, strategy_key
from service.report.groups import Groups
from service.report.page import Section

COLUMNS = (
    Column("outages at", "case"),
    Column("outage, days", "duration_days", 1),
    Column("strategy", "strategy"),
    Column("solves", "n_solves"),
    Column("solutions, paper's tolerance", "n_paper"),
    Column("ratio, %", "paper_ratio_percent"),
    Column("solutions, strict", "n_strict"),
    Column("ratio, %, strict", "strict_ratio_percent"),
    Column("core-s per strict solution", "core_seconds_per_strict"),
    Column("least delta-v, km/s", "least_delta_v_km_s", 3),
    Column("median delta-v, km/s", "median_delta_v_km_s", 3),
    Column("least propellant, kg", "least_propellant_kg", 1),
)


def cases_section(groups: Groups) -> Section:
    """Return the case tables, as far as the campaign has cases."""
    by_k: dict[int, list[Summary]] = {}
    for one in summaries(groups.findings, ("outages", "strategy")):
        by_k.setdefault(strategy_key(one.strategy or "")[0], []).append(one)
    paragraph = (
        "A case is a set of outages, named by the segments at which they begin. "
        "The paper gives no numbers by case."
    )
    tables = tuple(_table(k, by_k[k]) for k in sorted(by_k))
    return Section("cases", "Case by case", (paragraph,), tables)


def _table(k: int, groups: Sequence[Summary]) -> Table:
    rows = tuple(
        (
            (one.case or "").replace("-", ", ") or "none",
            one.duration_days or None,
            one.strategy,
            *(one.n_solves, one.n_paper, percent(one.paper_ratio)),
            *(one.n_strict, percent(one.strict_ratio)),
            seconds_per_solution(one.cost.core_hours, one.n_solves, one.strict_ratio),
            *(number(one.delta_v_km_s.least), number(one.delta_v_km_s.median)),
            number(one.propellant_kg.least),
        )
        for one in sorted(groups, key=_case_key)
    )
    n = len({row[:2] for row in rows})
    caption = (
        f"{n} {'case' if n == 1 else 'cases'}. Intervals of ratios are Wilson's, 95 %, and those of times "
        "follow from them. Delta-v is that of the transfer, of strict solutions."
    )
    return Table(f"cases-p{k}", f"Cases of P_{k}", caption, COLUMNS, rows)


def _case_key(one: Summary) -> tuple[float, list[int], tuple[int, int]]:
    segments = [int(part.partition(":")[0]) for part in (one.case or "").split("-") if part]
    return one.duration_days or 0.0, segments, strategy_key(one.strategy or "")
