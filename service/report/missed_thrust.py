"""The report of a missed-thrust analysis: one trajectory, or two side by side.

Maps of segment and duration, and the longest outage with a recovery for each segment.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, PowerNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from core.analysis.safe_modes import RECOVERIES
from service.report.page import Fact, Head, Picture, Section
from service.report.style import INK, ORANGE, SERIES, SOFT, new_figure
from service.report.tables import Cell, Column, Table
from service.report.write import write_page
from service.schemas.solution import Map, MissedThrustView, SegmentRisk

#: Maps with more cells than this get no numbers.
_MOST_NUMBERS = 200
#: Light to dark, for costs.
_COSTS = LinearSegmentedColormap.from_list("cost", ["#e8f1fb", "#7fb2e5", "#0072c3", "#0b2f5b"])

_LOST = LinearSegmentedColormap.from_list("lost", [ORANGE, ORANGE])


@dataclass(frozen=True, slots=True, eq=False)
class NamedView:
    """An analysis with the name that pictures give it."""

    name: str
    view: MissedThrustView


def cost_map(view: MissedThrustView, values: Map, unit: str) -> Figure:
    """Return a map over segment and duration: cost of the cheapest recovery, or that none was found."""
    figure, (axes,) = new_figure(1.5 + 0.32 * min(len(view.durations_days), 20))
    cells = np.array([[np.nan if cell is None else cell for cell in row] for row in values]).T
    tried = np.array(view.is_tried).T
    x, y = _cell_edges(len(view.segments)), _cell_edges(len(view.durations_days))
    top = max(float(np.nanmax(cells)), 1e-3) if np.isfinite(cells).any() else 1.0
    # Most costs are small, a few are large, and none is far below zero.
    norm = PowerNorm(0.5, 0.0, top, clip=True)
    lost = np.where(tried & ~np.isfinite(cells), 1.0, np.nan)
    axes.pcolormesh(x, y, np.ma.masked_invalid(lost), cmap=_LOST)
    mesh = axes.pcolormesh(x, y, np.ma.masked_invalid(cells), cmap=_COSTS, norm=norm)
    bar = figure.colorbar(mesh, ax=axes, label=unit, pad=0.01)
    bar.set_ticks([0.0, *(float(f"{share * top:.1g}") for share in (0.05, 0.2, 0.5, 1.0))])
    if cells.size <= _MOST_NUMBERS:
        _write_numbers(axes, x, y, cells, top)
    axes.set(xlabel="segment in which the outage begins", ylabel="duration, days")
    axes.set_xticks(0.5 * (x[1:] + x[:-1]), [str(row.segment) for row in view.segments], fontsize=7.5)
    axes.set_yticks(0.5 * (y[1:] + y[:-1]), [f"{days:g}" for days in view.durations_days])
    axes.grid(False)
    axes.legend(
        handles=[Patch(color=ORANGE, label="no recovery found")],
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.2,
    )
    return figure


def _write_numbers(axes: Axes, x: np.ndarray, y: np.ndarray, cells: np.ndarray, top: float) -> None:
    """Write costs into their cells, light on dark cells."""
    for (row, column), cost in np.ndenumerate(cells):
        if np.isfinite(cost):
            colour = "white" if cost > 0.3 * top else INK
            place = 0.5 * (x[column] + x[column + 1]), 0.5 * (y[row] + y[row + 1])
            # Narrow enough for thirty cells in a row; no sign on what rounds to zero.
            text = f"{cost:.0f}" if abs(cost) >= 9.95 else f"{round(cost, 1) + 0.0:.1f}"
            axes.text(*place, text, ha="center", va="center", fontsize=6.0, color=colour)


def longest(shown: Sequence[NamedView]) -> Figure:
    """Return the longest outage with a recovery for each segment, above the throttle."""
    figure, (axes, below) = _two_rows()
    last = max(max(one.view.durations_days) for one in shown)
    for number, one in enumerate(shown):
        _curve(axes, one, number)
    median = RECOVERIES.median()
    if median < 1.15 * last:
        axes.axhline(median, color=SOFT, linewidth=0.9, linestyle=(0, (4, 3)))
        axes.annotate(
            "median outage", (0.0, median), (4, 3), xycoords=("axes fraction", "data"), color=SOFT,
            textcoords="offset points", fontsize=8.0,
        )  # fmt: skip
    axes.set(ylabel="longest outage with\na recovery, days", ylim=(0.0, 1.12 * last))
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.2)
    for number, one in enumerate(shown):
        throttles = one.view.throttles
        below.step(range(1, len(throttles) + 1), throttles, where="mid", color=SERIES[number], linewidth=1.2)
    below.set(xlabel="segment in which the outage begins", ylabel="throttle", ylim=(-0.03, 1.08))
    return figure


def _curve(axes: Axes, one: NamedView, number: int) -> None:
    rows, colour = one.view.segments, SERIES[number]
    segments, days = [row.segment for row in rows], [row.longest_days for row in rows]
    axes.plot(segments, days, color=colour, label=one.name, marker="o", markersize=3.2, zorder=3 - number)
    opened = [row for row in rows if row.is_open]
    axes.plot(
        [row.segment for row in opened], [row.longest_days for row in opened], "^", color=colour,
        markersize=5.5, zorder=3 - number,
    )  # fmt: skip


def _two_rows() -> tuple[Figure, tuple[Axes, Axes]]:
    figure, (axes,) = new_figure(3.7)
    figure.delaxes(axes)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    return figure, (above, below)


def _cell_edges(count: int) -> np.ndarray:
    """Return the edges of cells of width one."""
    return np.arange(count + 1.0)


_MAPS = (
    ("propellant", "propellant_kg", "Propellant", "beyond the reference's", "propellant, kg"),
    ("delay", "delay_days", "Delay", "of the end of the last burn", "delay, days"),
)
_FROZEN = (
    "The reference is followed until the outage; then the spacecraft coasts, and the rest is re-optimized "
    "for the most mass at arrival. A recovery from a longer outage is one from a shorter one too."
)


def write_missed_thrust(views: Sequence[MissedThrustView], folder: Path) -> Path:
    """Write the report of one analysis, or of two side by side, and return the path of the page."""
    shown = [NamedView(name, view) for name, view in zip(names_of(views), views, strict=True)]

    def build() -> tuple[Head, Sequence[Section]]:
        return _head(shown), [_overview(shown), *(_maps(number, one) for number, one in enumerate(shown))]

    return write_page(build, folder)


def names_of(views: Sequence[MissedThrustView]) -> list[str]:
    """Return the names of solutions: k and the first digits of their ids."""
    return [f"k = {view.k}, {view.solution_id[:8]}" for view in views]


def segment_table(views: Sequence[MissedThrustView]) -> Table:
    """Return longest outage and probability of loss for each segment; several analyses side by side."""
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
        "Lost: probability that the one safe mode of the transfer begins in this segment and has no recovery."
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
        f"Fragile: thrusts, and has no recovery from an outage of median length ({RECOVERIES.median():.2f} "
        "days). At most: if segments that recover from the longest outage tried recover from any."
    )
    return Table("summary", "Summary", caption, columns, rows)


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


def _head(shown: Sequence[NamedView]) -> Head:
    view = shown[0].view
    facts = (
        Fact("outages tried", f"{sum(map(sum, view.is_tried)):,}"),
        Fact("CPU time", f"{sum(one.view.cpu_seconds for one in shown) / 60.0:.0f} min"),
        Fact("fragile segments", str(len(view.fragile))),
    )
    is_over = all(one.view.campaign_state == "done" for one in shown)
    notices = () if is_over else ("This analysis has not ended; cells without a colour are pending.",)
    title = " beside ".join(f"solution {one.view.solution_id[:8]}" for one in shown)
    return Head(view.campaign_id, f"Missed thrust: {title}", facts, notices)


def _overview(shown: Sequence[NamedView]) -> Section:
    views = [one.view for one in shown]
    caption = (
        "The longest outage from which the target can still be reached, by the segment in which it begins; a "
        "triangle marks the longest that was tried. Below, the throttle of the reference."
    )
    picture = Picture("longest", "Longest outage of each segment", caption, longest(shown))
    tables = (summary_table(views), segment_table(views))
    return Section("overview", "Outages with a recovery", (_FROZEN,), tables, (picture,))


def _maps(number: int, one: NamedView) -> Section:
    suffix = f"-{number + 1}" if number else ""
    pictures = tuple(
        Picture(
            f"{name}{suffix}",
            f"{title} of recoveries",
            f"{one.name}: {title.lower()} {than} of the cheapest recovery from an outage so long or longer.",
            cost_map(one.view, getattr(one.view, field), unit),
        )
        for name, field, title, than, unit in _MAPS
    )
    return Section(f"maps{suffix}", f"What recoveries cost: {one.name}", (), (), pictures)
