"""Figures that sections share: box plots of samples, forest plots of estimates; conversions of estimates."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, isfinite, log10
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cbook import boxplot_stats
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from core.analysis.metrics import Estimate, Ratio, Spread
from service.report.page import Picture
from service.report.style import BAND, BLUE, GAP, INK, ORANGE, SOFT, new_figure
from service.report.tables import significant

#: Height of a row, and of what surrounds the rows [in].
BOX_ROW, BOX_REST = 0.27, 1.0
#: Fewer values than this are drawn as points.
LEAST_FOR_BOX = 5


@dataclass(frozen=True, slots=True)
class Sample:
    """One row: its values, and a published mean where there is one."""

    group: str
    label: str
    values: tuple[float, ...]
    published_mean: float | None = None


def boxes(samples: Sequence[Sample], label: str, resolution: float, zero_line: bool = False) -> Figure:
    """Return a box plot of the samples, from top to bottom, merging outliers closer than the resolution."""
    figure, (axes,) = new_figure(BOX_REST + BOX_ROW * len(samples))
    axes.set(ylim=(len(samples) - 0.5, -0.5), xlabel=label)
    _shade(axes, samples)
    if zero_line:
        axes.axvline(0.0, color=SOFT, linewidth=1.0, linestyle=(0, (4, 3)))
    for place, sample in enumerate(samples):
        if len(sample.values) >= LEAST_FOR_BOX:
            _box(axes, place, np.array(sample.values), resolution)
        elif sample.values:
            axes.plot(sample.values, [place] * len(sample.values), "o", color=BLUE, markersize=3.2)
    _means(axes, samples)
    _names(axes, samples)
    figure.legend(handles=_legend(samples), loc="outside upper left", ncols=4, handletextpad=0.4)
    return figure


def _box(axes: Axes, place: float, values: np.ndarray, resolution: float) -> None:
    (stats,) = boxplot_stats(values)
    stats["fliers"] = np.unique(np.round(np.asarray(stats["fliers"]) / resolution)) * resolution
    line = {"color": BLUE, "linewidth": 1.2}
    axes.bxp(
        [stats],
        positions=[place],
        orientation="horizontal",
        widths=0.56,
        manage_ticks=False,
        boxprops=line,
        whiskerprops=line,
        capprops=line,
        medianprops={"color": BLUE, "linewidth": 2.4, "solid_capstyle": "butt"},
        flierprops={"marker": ".", "markersize": 3.0, "markerfacecolor": BLUE, "markeredgecolor": "none"},
    )


def _means(axes: Axes, samples: Sequence[Sample]) -> None:
    ours = [(float(np.mean(one.values)), place) for place, one in enumerate(samples) if one.values]
    published = [
        (one.published_mean, place) for place, one in enumerate(samples) if one.published_mean is not None
    ]
    for found, style in ((ours, OUR_MEAN), (published, PUBLISHED_MEAN)):
        axes.plot([x for x, _ in found], [y for _, y in found], linestyle="none", zorder=4, **style)


OUR_MEAN: dict[str, Any] = {"marker": "x", "color": INK, "markersize": 5.0, "markeredgewidth": 1.4}
PUBLISHED_MEAN: dict[str, Any] = {
    "marker": "D",
    "color": ORANGE,
    "markerfacecolor": "none",
    "markersize": 4.8,
    "markeredgewidth": 1.4,
}


def _legend(samples: Sequence[Sample]) -> list[Line2D]:
    handles = [
        Line2D([], [], color=BLUE, linewidth=2.4, label="median, quartiles, whiskers"),
        Line2D([], [], linestyle="none", label="mean", **OUR_MEAN),
    ]
    if any(sample.published_mean is not None for sample in samples):
        handles.append(Line2D([], [], linestyle="none", label="published mean", **PUBLISHED_MEAN))
    return handles


def _shade(axes: Axes, samples: Sequence[Sample]) -> None:
    groups = list(dict.fromkeys(sample.group for sample in samples))
    for place, sample in enumerate(samples):
        if groups.index(sample.group) % 2 == 0:
            axes.axhspan(place - 0.5, place + 0.5, color=BAND, linewidth=0, zorder=0)


def _names(axes: Axes, samples: Sequence[Sample]) -> None:
    names, seen = [], set()
    for sample in samples:
        names.append(
            "\u00a0\u00a0\u00a0".join(
                filter(None, ("" if sample.group in seen else sample.group, sample.label))
            )
        )
        seen.add(sample.group)
    axes.set_yticks(range(len(samples)), names)
    axes.tick_params(axis="y", length=0)
    axes.grid(False, axis="y")
    for place, sample in enumerate(samples):
        count = f"n = {len(sample.values):,}"
        beside = axes.get_yaxis_transform()
        axes.text(1.015, place, count, transform=beside, color=SOFT, fontsize=8, verticalalignment="center")


#: Height of a row, and of what surrounds the rows [in].
ROW, REST = 0.215, 0.95
#: Tick labels of durations and of costs in core-seconds.
TIMES = {1.0: "1 s", 60.0: "1 min", 3600.0: "1 h", 86400.0: "1 d", 8.64e6: "100 d"}
#: More ticks, for axes that span few decades.
FINE_TIMES = {0.1: "0.1 s", 10.0: "10 s", 600.0: "10 min", 36000.0: "10 h", 864000.0: "10 d"}


@dataclass(frozen=True, slots=True)
class Series:
    """The marks of one colour."""

    name: str
    colour: str
    marker: str = "o"
    is_filled: bool = True


@dataclass(frozen=True, slots=True)
class Row:
    """One line: rows of a group are adjacent; marks in the order of the series, None where unknown."""

    group: str
    label: str
    marks: tuple[Estimate | None, ...]


@dataclass(frozen=True, slots=True)
class Chart:
    """A forest plot before it is drawn."""

    name: str
    title: str
    caption: str
    #: Of the horizontal axis.
    label: str
    series: Sequence[Series]
    rows: Sequence[Row]
    is_time: bool = False

    def picture(self) -> Picture:
        """Draw the plot."""
        figure = forest(self.rows, self.series, self.label, self.is_time)
        return Picture(self.name, self.title, self.caption, figure)


def forest(rows: Sequence[Row], series: Sequence[Series], label: str, is_time: bool) -> Figure:
    """Return a forest plot of the rows, from top to bottom, with a mark and an interval for each series."""
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
    # Zero and infinity are not on a logarithmic axis: only their intervals are drawn.
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
    """Return limits of the axis that hold all marks and the ends of their intervals."""
    ends = [end for row in rows for mark in row.marks if mark is not None for end in mark]
    places = [log10(end) for end in ends if isfinite(end) and end > 0.0]
    if not places:
        return 0.1, 100.0
    room = 0.04 * max(1.0, max(places) - min(places))
    # An interval that begins at zero is cut at the left limit.
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
    # Few enough for their labels not to overlap.
    names = TIMES if log10(limits[1] / limits[0]) > 3.5 else TIMES | FINE_TIMES
    return [time for time in sorted(names) if limits[0] <= time <= limits[1]], lambda time: names[time]


def _decades(limits: tuple[float, float]) -> tuple[list[float], Callable[[float], str]]:
    steps = (1.0,) if log10(limits[1] / limits[0]) > 3.0 else (1.0, 2.0, 5.0)
    places = [step * 10.0**power for power in range(-9, 10) for step in steps]
    inside = [place for place in places if limits[0] <= place <= limits[1]]
    return inside, lambda value: significant(value, 1)


SECONDS_PER_HOUR = 3600.0


def percent(ratio: Ratio) -> Estimate | None:
    """Return a ratio in percent, None without any guess."""
    return None if ratio.value != ratio.value else Estimate(*(100.0 * value for value in ratio))


def seconds_per_solution(hours: float, n_solves: int, ratio: Ratio) -> Estimate | None:
    """Return core-seconds per solution; the interval is that of the ratio, and open while it is zero."""
    if not n_solves:
        return None
    seconds = SECONDS_PER_HOUR * hours / n_solves
    return Estimate(
        *(seconds / share if share > 0.0 else inf for share in (ratio.value, ratio.high, ratio.low))
    )


def in_seconds(hours: Estimate) -> Estimate:
    """Return core-hours as core-seconds."""
    return Estimate(*(SECONDS_PER_HOUR * value for value in hours))


def mean_of(spread: Spread) -> Estimate | None:
    """Return a mean with its interval, which is NaN for a single value."""
    return Estimate(spread.mean, spread.mean_low, spread.mean_high) if spread.n else None


def number(value: float) -> float | None:
    """Return a number, or None for NaN."""
    return None if value != value else value


def duration_label(days: float | None) -> str:
    """Return the duration of the outages as text: empty without outages."""
    if days is None:
        return "mixed"
    return f"{days:.1f} d" if days else ""


def strategy_key(strategy: str) -> tuple[int, int]:
    """Return (k, k') of a strategy, whatever its mapping; k' of one without seeds is -1."""
    strategy, _, _ = strategy.partition(" ")
    k, _, seed_k = strategy.removeprefix("S(").removesuffix(")").partition("|")
    return (int(k), int(seed_k) if seed_k else -1) if k.isdecimal() else (10_000, -1)
