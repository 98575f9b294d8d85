"""Samples side by side: Tukey's boxes, or points where there are few values."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cbook import boxplot_stats
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from service.report.style import BAND, BLUE, INK, ORANGE, SOFT, new_figure

#: Height of a row, and of what surrounds the rows [in].
ROW, REST = 0.27, 1.0
#: Fewer values than this are shown as they are.
LEAST_FOR_BOX = 5


@dataclass(frozen=True, slots=True)
class Sample:
    """One row: its values, and the paper's mean where there is one."""

    group: str
    label: str
    values: tuple[float, ...]
    paper_mean: float | None = None


def boxes(samples: Sequence[Sample], label: str, resolution: float, zero_line: bool = False) -> Figure:
    """Return the samples from top to bottom; outliers nearer than the resolution are one point."""
    figure, (axes,) = new_figure(REST + ROW * len(samples))
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
    paper = [(one.paper_mean, place) for place, one in enumerate(samples) if one.paper_mean is not None]
    for found, style in ((ours, OUR_MEAN), (paper, PAPER_MEAN)):
        axes.plot([x for x, _ in found], [y for _, y in found], linestyle="none", zorder=4, **style)


OUR_MEAN: dict[str, Any] = {"marker": "x", "color": INK, "markersize": 5.0, "markeredgewidth": 1.4}
PAPER_MEAN: dict[str, Any] = {
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
    if any(sample.paper_mean is not None for sample in samples):
        handles.append(Line2D([], [], linestyle="none", label="paper's mean", **PAPER_MEAN))
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
