"""The report of a missed-thrust analysis: one trajectory, or two beside each other."""

from collections.abc import Sequence
from pathlib import Path

from core.analysis.safe_modes import RECOVERIES
from service.report.cells import Cell, Column, Table
from service.report.missed_thrust_plot import Shown, cost_map, longest
from service.report.page import Fact, Head, Picture, Section
from service.report.write import write_page
from service.schemas.solution import MissedThrustView, SegmentRisk

_MAPS = (
    ("propellant", "propellant_kg", "Propellant", "beyond the reference's", "propellant, kg"),
    ("delay", "delay_days", "Delay", "of the end of the last burn", "delay, days"),
)
_FROZEN = (
    "Until the outage the reference is flown as it is; then the spacecraft coasts, and what is left is "
    "optimized afresh for the most mass at arrival. A recovery from a longer outage is one from a shorter "
    "one too."
)


def write_missed_thrust(views: Sequence[MissedThrustView], folder: Path) -> Path:
    """Write the report of one analysis, or of two beside each other, and return where the page is."""
    shown = [Shown(name, view) for name, view in zip(names_of(views), views, strict=True)]

    def made() -> tuple[Head, Sequence[Section]]:
        return _head(shown), [_overview(shown), *(_maps(number, one) for number, one in enumerate(shown))]

    return write_page(made, folder)


def names_of(views: Sequence[MissedThrustView]) -> list[str]:
    """Return what solutions are called: by k, and by the beginnings of their ids."""
    return [f"k = {view.k}, {view.solution_id[:8]}" for view in views]


def segment_table(views: Sequence[MissedThrustView]) -> Table:
    """Return what each segment takes, with the lost probability; several analyses side by side."""
    named = len(views) > 1
    columns = [Column("segment", "segment")]
    for number, view in enumerate(views):
        about = f" (k = {view.k})" if named else ""
        key = f"_{number + 1}" if named else ""
        columns += [
            Column(f"begins, day{about}", f"start_days{key}", 1),
            Column(f"throttle{about}", f"throttle{key}", 2),
            Column(f"longest outage, days{about}", f"longest_days{key}", 2),
            Column(f"lost, %{about}", f"lost_percent{key}", 2),
        ]
    by_segment = [{row.segment: row for row in view.segments} for view in views]
    rows: list[tuple[Cell, ...]] = []
    for segment in sorted(set().union(*by_segment)):
        cells: list[Cell] = [segment]
        for known in by_segment:
            row = known.get(segment)
            cells += [None] * 4 if row is None else _cells(row)
        rows.append(tuple(cells))
    caption = (
        "Lost: probability that the one safe mode of the transfer begins in this very segment and has no "
        "recovery."
    )
    return Table("segments", "Segment by segment", caption, tuple(columns), tuple(rows))


def _cells(row: SegmentRisk) -> list[Cell]:
    return [row.start_days, row.throttle, row.longest_days, 100.0 * row.lost_probability]


def summary_table(views: Sequence[MissedThrustView]) -> Table:
    """Return mass, probabilities and fragile segments of analyses."""
    columns = (
        Column("solution", "solution"),
        Column("k", "k"),
        Column("final mass, kg", "final_mass_kg", 1),
        Column("last burn ends, day", "arrival_days", 1),
        Column("no safe mode", "none", 3),
        Column("exactly one", "one", 3),
        Column("recovered, given one: at least", "recovered_least", 3),
        Column("at most", "recovered_most", 3),
        Column("weakest, days", "weakest_days", 2),
        Column("fragile segments", "fragile"),
    )
    rows = tuple(_summary(view) for view in views)
    caption = (
        f"Fragile: thrusts, and takes no outage of median length ({RECOVERIES.median():.2f} days). At most: "
        "if segments that take the longest outage tried take any."
    )
    return Table("summary", "In short", caption, columns, rows)


def _summary(view: MissedThrustView) -> tuple[Cell, ...]:
    chance = view.survivability
    return (
        view.solution_id[:8],
        view.k,
        view.final_mass_kg,
        view.arrival_days,
        chance.none,
        chance.one,
        chance.recovered_given_one_least,
        chance.recovered_given_one_most,
        min(row.longest_days for row in view.segments),
        ", ".join(map(str, view.fragile)) or "none",
    )


def _head(shown: Sequence[Shown]) -> Head:
    view = shown[0].view
    facts = (
        Fact("outages tried", f"{sum(map(sum, view.is_tried)):,}"),
        Fact("CPU time", f"{sum(one.view.cpu_seconds for one in shown) / 60.0:.0f} min"),
        Fact("fragile segments", str(len(view.fragile))),
    )
    is_over = all(one.view.campaign_state == "done" for one in shown)
    notices = () if is_over else ("This analysis has not ended; cells without a colour are still to come.",)
    title = " beside ".join(f"solution {one.view.solution_id[:8]}" for one in shown)
    return Head(view.campaign_id, f"Missed thrust: {title}", facts, notices)


def _overview(shown: Sequence[Shown]) -> Section:
    views = [one.view for one in shown]
    caption = (
        "The longest outage from which the target can still be reached, by the segment in which it begins; a "
        "triangle says that it is the longest that was tried. Below, the throttle of the reference."
    )
    picture = Picture("longest", "Longest outage of each segment", caption, longest(shown))
    tables = (summary_table(views), segment_table(views))
    return Section("overview", "Which outages it takes", (_FROZEN,), tables, (picture,))


def _maps(number: int, one: Shown) -> Section:
    suffix = f"-{number + 1}" if number else ""
    pictures = tuple(
        Picture(
            f"{name}{suffix}",
            f"{title} of recoveries",
            f"{one.name}: {title.lower()} {than} of the cheapest recovery from outages so long or longer.",
            cost_map(one.view, getattr(one.view, field), unit),
        )
        for name, field, title, than, unit in _MAPS
    )
    return Section(f"maps{suffix}", f"What recoveries cost: {one.name}", (), (), pictures)
