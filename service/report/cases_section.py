"""Every case on its own: one table for each number of outages."""

from collections.abc import Sequence
from typing import NamedTuple

from core.analysis.campaign_statistics import case_name, grouped
from service.report.cells import Cell, Column, Table
from service.report.estimates import number, percent, seconds_per_solution, strategy_key
from service.report.groups import Groups, Tally, tally_of
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
    by_k: dict[int, list[_Case]] = {}
    for solves in grouped(groups.findings.facts.solves, ("outages", "strategy")).values():
        first = solves[0]
        by_k.setdefault(first.k, []).append(_Case(first.outages, first.strategy, tally_of(solves)))
    paragraph = (
        "A case is a set of outages, named by the segments at which they begin. "
        "The paper gives no numbers by case."
    )
    tables = tuple(_table(k, sorted(by_k[k], key=_Case.order)) for k in sorted(by_k))
    return Section("cases", "Case by case", (paragraph,), tables)


class _Case(NamedTuple):
    """What one strategy found for one case."""

    outages: tuple[tuple[int, float], ...]
    strategy: str
    tally: Tally

    @property
    def duration_days(self) -> float | None:
        """The duration that all its outages share, None without outages or where they differ."""
        durations = {duration for _, duration in self.outages}
        return durations.pop() if len(durations) == 1 else None

    def order(self) -> tuple[float, tuple[tuple[int, float], ...], tuple[int, int]]:
        """Return what cases are sorted by."""
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
