"""The sections that need no solve: how large Jacobians are, and what outages are to be expected."""

import numpy as np

from core.analysis.safe_modes import CountDistribution, count_distribution, quoted_statements
from core.analysis.sparsity import DensityRule, density_curve, pattern, sizes
from core.problem import Problem
from service.report.cells import DERIVED, PRINTED, READ, Cell, Column, Table
from service.report.outages_plot import counts, durations
from service.report.page import Picture, Section
from service.report.sparsity_plot import Curve, PaperMark, Pattern, density, patterns

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
    """Return how many safe modes an arc sees, and how long outages last."""
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
    caption = "Probabilities of how many safe modes begin on an arc."
    return Table("outage-counts", "Number of safe modes", caption, columns, rows)


def _statements() -> Table:
    columns = (
        Column("statement", "statement"),
        Column("probability", "probability", 3),
        Column("paper", "published_probability", 2, PRINTED),
    )
    rows = tuple((one.sentence, one.value, one.paper) for one in quoted_statements())
    caption = "The three numbers that the paper quotes, in words that say what they are the probability of."
    return Table("outage-statements", "What the paper quotes", caption, columns, rows)
