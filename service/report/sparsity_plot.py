"""Which entries of a Jacobian are there, and how their number grows with the number of segments."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import FuncFormatter, NullFormatter
from numpy.typing import NDArray

from service.report.style import BLUE, ORANGE, SERIES, SOFT, WIDTH


@dataclass(frozen=True, slots=True, eq=False)
class Pattern:
    """One Jacobian: where its entries are."""

    title: str
    #: (n_rows, n_columns) whether an entry is there.
    entries: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Curve:
    """Entries over the number of segments, for one rule and one spacing of outages."""

    rule: str
    spacing: int
    n_segments: tuple[int, ...]
    n_entries: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class PaperMark:
    """An entry count that the paper's figure shows."""

    n_segments: int
    n_entries: int


def patterns(shown: Sequence[Pattern]) -> Figure:
    """Return the patterns one above the other, on one scale of columns."""
    figure = Figure(figsize=(WIDTH, 1.75 * len(shown)), layout="constrained")
    widest = max(pattern.entries.shape[1] for pattern in shown)
    for axes, pattern in zip(figure.subplots(len(shown), sharex=True), shown, strict=True):
        n_rows, n_columns = pattern.entries.shape
        axes.add_patch(PathPatch(_rectangles(pattern.entries), facecolor=BLUE, linewidth=0))
        axes.plot((n_columns, n_columns), (0, n_rows), color=SOFT, linewidth=0.8, linestyle=(0, (3, 2)))
        axes.set(xlim=(0, widest), ylim=(n_rows, 0), title=pattern.title, ylabel="constraint")
        axes.grid(False)
    axes.set_xlabel("variable")
    return figure


def _rectangles(entries: NDArray[np.bool_]) -> Path:
    """Return rectangles that cover the entries: rows that are alike, one after the other, are one."""
    changes = np.flatnonzero(np.any(entries[1:] != entries[:-1], axis=1)) + 1
    corners: list[tuple[int, int]] = []
    for top, bottom in zip((0, *changes), (*changes, len(entries)), strict=True):
        edges = np.flatnonzero(np.diff(np.concatenate(([0], entries[top].astype(np.int8), [0]))))
        for left, right in edges.reshape(-1, 2).tolist():
            corners += [(left, top), (right, top), (right, bottom), (left, bottom), (left, top)]
    codes = [Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY] * (len(corners) // 5)
    return Path(corners, codes)


def density(curves: Sequence[Curve], paper: Sequence[PaperMark] = ()) -> Figure:
    """Return the curves on logarithmic axes: a colour per spacing, a line style per rule."""
    figure = Figure(figsize=(WIDTH, 3.6), layout="constrained")
    axes = figure.subplots()
    spacings = sorted({curve.spacing for curve in curves})
    rules = list(dict.fromkeys(curve.rule for curve in curves))
    for curve in curves:
        axes.plot(
            curve.n_segments,
            curve.n_entries,
            color=SERIES[spacings.index(curve.spacing)],
            linestyle=("-", (0, (5, 2)), (0, (1, 1.5)))[rules.index(curve.rule)],
            label=f"M = {curve.spacing}, {curve.rule}",
        )
    if paper:
        axes.plot(
            [mark.n_segments for mark in paper],
            [mark.n_entries for mark in paper],
            linestyle="none",
            marker="D",
            color=ORANGE,
            markerfacecolor="none",
            markersize=5,
            label="paper, read from its figure 6",
        )
    axes.set(xscale="log", yscale="log", xlabel="segments N", ylabel="dense entries of the Jacobian")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
        axis.set_minor_formatter(NullFormatter())
    axes.legend(loc="upper left")
    return figure
