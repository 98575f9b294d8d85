"""The paper's figures that need no solve: sparsity of Jacobians, and frequency and duration of safe modes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import FuncFormatter, NullFormatter
from numpy.typing import NDArray

from core.analysis.safe_modes import CountDistribution, count_distribution, duration_cdf, quoted_statements
from core.analysis.sparsity import DensityRule, density_curve, pattern, sizes
from core.problem import Problem
from service.report.page import Picture, Section
from service.report.paper.values import DERIVED, PRINTED, READ
from service.report.style import BLUE, INK, ORANGE, SERIES, SOFT, WIDTH, new_figure
from service.report.tables import Cell, Column, Table


@dataclass(frozen=True, slots=True, eq=False)
class Pattern:
    """The sparsity pattern of one Jacobian."""

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
    """Return the patterns one above the other, with a common horizontal scale."""
    figure = Figure(figsize=(WIDTH, 1.75 * len(shown)), layout="constrained")
    widest = max(one.entries.shape[1] for one in shown)
    for axes, one in zip(figure.subplots(len(shown), sharex=True), shown, strict=True):
        n_rows, n_columns = one.entries.shape
        axes.add_patch(PathPatch(_rectangles(one.entries), facecolor=BLUE, linewidth=0))
        axes.plot((n_columns, n_columns), (0, n_rows), color=SOFT, linewidth=0.8, linestyle=(0, (3, 2)))
        axes.set(xlim=(0, widest), ylim=(n_rows, 0), title=one.title, ylabel="constraint")
        axes.grid(False)
    axes.set_xlabel("variable")
    return figure


def _rectangles(entries: NDArray[np.bool_]) -> Path:
    """Return rectangles that cover the entries; equal consecutive rows share theirs."""
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


#: The paper's figure 5: outages at n = 8 + 8k, k = 0 .. 11, of 100 segments.
N_SHOWN, SHOWN = 100, tuple(range(8, 97, 8))
#: Spacings M of the paper's figure 6, and the numbers of segments on its axis.
SPACINGS = (2, 4, 8)
N_VALUES = tuple(int(n) for n in np.unique(np.round(np.geomspace(16, 1000, 60) / 8) * 8))
#: Marks of the paper's figure 6: (segments, segmentation, entries).
PUBLISHED = ((100, "adaptive", 16_332), (100, "uniform", 36_777), (50, "adaptive", 8_859))
#: Arcs of the counts [days]: the two that the paper speaks of, and one between them.
ARCS = (98.0, 150.0, 276.0)
N_MOST = 4


def sparsity_section(problem: Problem) -> Section:
    """Return the patterns of the Jacobian and the growth of its entries."""
    return Section(
        "sparsity",
        "Sparsity of the Jacobian",
        (
            "Adaptive realizations have the N − n segments that are left after an outage at segment n, "
            "uniform ones as many as the reference. The text of the paper and the marks of its figure 6 "
            "follow different rules; both are here.",
        ),
        (_sizes_table(),),
        (_patterns_picture(problem), _density_picture("nearest"), _density_picture("published")),
    )


def _patterns_picture(problem: Problem) -> Picture:
    shown = []
    for segmentation in ("adaptive", "uniform"):
        changed = problem.model_copy(update={"n_segments": N_SHOWN, "segmentation": segmentation})
        entries = pattern(changed.with_outages([(n, 1.0) for n in SHOWN]))
        n_rows, n_columns = entries.shape
        title = f"{segmentation}: {n_rows} × {n_columns:,}, {entries.nnz:,} entries"
        shown.append(Pattern(title, entries.toarray()))
    caption = (
        f"Where the Jacobian of the defects can have entries, N = {N_SHOWN}, outages at segments 8, 16, "
        ".., 96, as the paper's figure 5; realizations start from the nearer half of the reference, and "
        "mass rows hold only what masses depend on. A dashed line marks the last variable."
    )
    return Picture("jacobian-patterns", "Jacobian patterns", caption, patterns(shown))


def _density_picture(rule: DensityRule) -> Picture:
    curves = [
        Curve(
            segmentation,
            spacing,
            N_VALUES,
            tuple(density_curve(spacing, N_VALUES, segmentation, rule).tolist()),
        )
        for spacing in SPACINGS
        for segmentation in ("adaptive", "uniform")
    ]
    marks = [PaperMark(n, entries) for n, _, entries in PUBLISHED]
    of_rule = {
        "nearest": "Density, as the problem is described",
        "published": "Density, as the paper's figure counts",
    }
    explained = {
        "nearest": "Outages at n = M, 2M, .., N; counted as coastarc builds its Jacobian.",
        "published": "Outages at n = 0, M, .., N, adaptive realizations of about half the segments "
        "left: the rule that the marks of the paper's figure 6 follow.",
    }
    caption = (
        f"Dense entries over the number N of segments, M = 2, 4, 8. {explained[rule]} Straight lines: N²."
    )
    return Picture(f"density-{rule}", of_rule[rule], caption, density(curves, marks))


def _sizes_table() -> Table:
    columns = (
        Column("segments", "segmentation"),
        Column("variables", "n_variables"),
        Column("dense entries, nearer half", "dense_nearest"),
        Column("with sparse mass rows", "sparse_nearest"),
        Column("dense entries, forward half", "dense_forward"),
        Column("figure 6, mark", "published_mark", source=READ),
        Column("figure 6, rule", "published_rule", source=DERIVED),
    )
    marks = {segmentation: entries for n, segmentation, entries in PUBLISHED if n == N_SHOWN}
    rows: list[tuple[Cell, ...]] = []
    for segmentation in ("adaptive", "uniform"):
        near, forward = (sizes(N_SHOWN, SHOWN, segmentation, rule) for rule in ("nearest", "forward"))
        (by_rule,) = density_curve(8, [N_SHOWN], segmentation, "published").tolist()
        counted = (near.n_variables, near.dense, near.sparse, forward.dense)
        rows.append((segmentation, *counted, marks[segmentation], by_rule))
    caption = f"N = {N_SHOWN}, outages at segments 8, 16, .., 96: 13 trajectories, 91 defects."
    return Table("jacobian-sizes", "Sizes of the Jacobian", caption, columns, tuple(rows))


def outages_section() -> Section:
    """Return distributions of the number of safe modes and of the duration of outages."""
    arcs = [count_distribution(arc, N_MOST) for arc in ARCS]
    law = (
        "Weibull laws as public code gives them with reference to Imken et al. 2018; times between safe "
        "modes independent, the time that outages last neglected."
    )
    pictures = (
        Picture("outage-counts", "Safe modes per arc", f"Probability of each number. {law}", counts(arcs)),
        Picture(
            "outage-durations",
            "Durations of outages",
            f"Probability that an outage is over, with the paper's three durations marked. {law}",
            durations(),
        ),
    )
    return Section("outages", "Outages to be expected", (), (_counts_table(arcs), _statements()), pictures)


def _counts_table(arcs: list[CountDistribution]) -> Table:
    columns = (
        Column("arc, days", "arc_days", 0),
        *(Column(f"P({n})", f"p_{n}", 3) for n in range(N_MOST + 1)),
        Column("at most one", "p_at_most_one", 3),
        Column("at least one", "p_at_least_one", 3),
        Column("one, given any", "p_one_given_any", 3),
        Column("mean", "mean", 2),
    )
    rows = tuple(
        (
            one.arc_days,
            *(float(value) for value in one.probabilities),
            *(one.at_most_one, one.at_least_one, one.one_given_any, one.mean),
        )
        for one in arcs
    )
    caption = "Probability of each number of safe modes that begin on an arc."
    return Table("outage-counts", "Number of safe modes", caption, columns, rows)


def _statements() -> Table:
    columns = (
        Column("statement", "statement"),
        Column("probability", "probability", 3),
        Column("paper", "published_probability", 2, PRINTED),
    )
    rows = tuple((one.sentence, one.value, one.paper) for one in quoted_statements())
    caption = "The three numbers that the paper quotes, with the event that each is the probability of."
    return Table("outage-statements", "What the paper quotes", caption, columns, rows)
