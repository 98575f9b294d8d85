"""How many safe modes an arc sees, and how long outages last."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from core.analysis.safe_modes import CountDistribution, duration_cdf
from service.report.style import BLUE, INK, SERIES, new_figure

#: The durations of the paper's outages [days], and the end of the axis.
STUDIED_DAYS = (0.5, 1.0, 1.5)
LAST_DAY = 10.0


def counts(distributions: Sequence[CountDistribution]) -> Figure:
    """Return the probability of each number of safe modes, one bar per arc."""
    figure, (axes,) = new_figure(2.9)
    width = 0.8 / len(distributions)
    for number, one in enumerate(distributions):
        places = np.arange(len(one.probabilities)) + (number - (len(distributions) - 1) / 2) * width
        name = f"{one.arc_days:g} days"
        bars = axes.bar(places, one.probabilities, width * 0.9, color=SERIES[number], label=name)
        axes.bar_label(
            bars, [_share(value) for value in one.probabilities], fontsize=7.0, color=INK, padding=1
        )
    axes.set(xlabel="safe modes on the arc", ylabel="probability")
    axes.grid(False, axis="x")
    axes.legend(loc="upper right")
    return figure


def _share(value: float) -> str:
    return f"{value:.2f}".removeprefix("0") if value >= 0.005 else ""


def durations() -> Figure:
    """Return the distribution of the durations of outages, with those of the paper's cases marked."""
    figure, (axes,) = new_figure(2.7)
    days = np.linspace(0.0, LAST_DAY, 401)
    axes.plot(days, duration_cdf(days), color=BLUE)
    reached = duration_cdf(np.array(STUDIED_DAYS))
    for day, share in zip(STUDIED_DAYS, reached, strict=True):
        axes.annotate(
            f"{day:g} d: {share:.2f}", (day, share), (8, -6), textcoords="offset points", fontsize=8
        )
    axes.plot(STUDIED_DAYS, reached, "o", color=BLUE, markersize=4)
    axes.set(
        xlim=(0.0, LAST_DAY), ylim=(0.0, 1.02), xlabel="duration, days", ylabel="share that ends by then"
    )
    return figure
