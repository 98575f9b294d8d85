"""Estimates with their intervals, one row each: a forest plot on a logarithmic axis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite, log10

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from core.analysis.metrics import Estimate
from service.report.cells import significant
from service.report.style import BAND, GAP, new_figure

#: Height of a row, and of what surrounds the rows [in].
ROW, REST = 0.215, 0.95
#: What a duration or a cost in core-seconds is called on an axis.
TIMES = {1.0: "1 s", 60.0: "1 min", 3600.0: "1 h", 86400.0: "1 d", 8.64e6: "100 d"}
#: A tenth and a hundred times of these have no name of their own.
FINE_TIMES = {0.1: "0.1 s", 10.0: "10 s", 600.0: "10 min", 36000.0: "10 h", 864000.0: "10 d"}


@dataclass(frozen=True, slots=True)
class Series:
    """What the marks of one colour are."""

    name: str
    colour: str
    marker: str = "o"
    is_filled: bool = True


@dataclass(frozen=True, slots=True)
class Row:
    """One line: rows of a group stand together; marks in the order of the series, None where unknown."""

    group: str
    label: str
    marks: tuple[Estimate | None, ...]


def forest(rows: Sequence[Row], series: Sequence[Series], label: str, is_time: bool) -> Figure:
    """Return the rows from top to bottom, each with a mark and an interval for each series."""
    figure, (axes,) = new_figure(REST + ROW * len(rows))
    low, high = _limits(rows)
    axes.set(xscale="log", xlim=(low, high), ylim=(len(rows) - 0.5, -0.5), xlabel=label)
    _shade_groups(axes, rows)
    for number, one in enumerate(series):
        offset = (number - (len(series) - 1) / 2) * 0.62 / max(1, len(series))
        found = [(place + offset, row.marks[number]) for place, row in enumerate(rows)]
        _draw(axes, one, [(place, mark) for place, mark in found if mark is not None], (low, high))
    _ticks(axes, rows, (low, high), is_time)
    figure.legend(loc="outside upper left", ncols=len(series), handletextpad=0.4, columnspacing=1.4)
    return figure


def _draw(
    axes: Axes, series: Series, marks: list[tuple[float, Estimate]], limits: tuple[float, float]
) -> None:
    low, high = limits
    for place, mark in marks:
        if mark.low == mark.low:  # Not where there is no interval.
            ends = (max(mark.low, low), min(mark.high, high))
            axes.plot(ends, (place, place), color=series.colour, linewidth=1.5, solid_capstyle="butt")
    # Zero and infinity have no place on the axis: their intervals stand alone.
    shown = [(mark.value, place) for place, mark in marks if low <= mark.value <= high]
    axes.plot(
        [value for value, _ in shown],
        [place for _, place in shown],
        linestyle="none",
        marker=series.marker,
        markersize=4.6,
        markeredgewidth=1.3,
        color=series.colour,
        markerfacecolor=series.colour if series.is_filled else "none",
        label=series.name,
    )


def _limits(rows: Sequence[Row]) -> tuple[float, float]:
    """Return the decades, or parts of them, that hold all marks and the ends of their intervals."""
    ends = [end for row in rows for mark in row.marks if mark is not None for end in mark]
    places = [log10(end) for end in ends if isfinite(end) and end > 0.0]
    if not places:
        return 0.1, 100.0
    room = 0.04 * max(1.0, max(places) - min(places))
    # Below a thousandth of the rest an interval that comes from zero is cut, not shown.
    return 10 ** (min(places) - room), 10 ** (max(places) + room)


def _shade_groups(axes: Axes, rows: Sequence[Row]) -> None:
    groups: list[str] = []
    for place, row in enumerate(rows):
        if not groups or groups[-1] != row.group:
            groups.append(row.group)
        if len(groups) % 2:
            axes.axhspan(place - 0.5, place + 0.5, color=BAND, linewidth=0, zorder=0)


def _ticks(axes: Axes, rows: Sequence[Row], limits: tuple[float, float], is_time: bool) -> None:
    names = []
    for before, row in zip((None, *rows), rows, strict=False):
        is_first = before is None or before.group != row.group
        names.append(GAP.join(filter(None, (row.group if is_first else "", row.label))))
    axes.set_yticks(range(len(rows)), names)
    axes.tick_params(axis="y", length=0)
    axes.grid(False, axis="y")
    places, named = _times(limits) if is_time else _decades(limits)
    axes.xaxis.set_major_locator(FixedLocator(places))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: named(value)))


def _times(limits: tuple[float, float]) -> tuple[list[float], Callable[[float], str]]:
    # Few enough for their names to stand side by side.
    names = TIMES if log10(limits[1] / limits[0]) > 3.5 else TIMES | FINE_TIMES
    return [time for time in sorted(names) if limits[0] <= time <= limits[1]], lambda time: names[time]


def _decades(limits: tuple[float, float]) -> tuple[list[float], Callable[[float], str]]:
    steps = (1.0,) if log10(limits[1] / limits[0]) > 3.0 else (1.0, 2.0, 5.0)
    places = [step * 10.0**power for power in range(-9, 10) for step in steps]
    inside = [place for place in places if limits[0] <= place <= limits[1]]
    return inside, lambda value: significant(value, 1)
