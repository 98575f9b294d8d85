"""Counts of entries against tables worked out by hand, the paper's figure and the Jacobian itself."""

import numpy as np
import pytest

from core.analysis.sparsity import dense_entries, density_curve, pattern, sizes
from core.transcription import transcribe
from tests.core.transcription.points import problem
from tests.core.transcription.test_layout import CASES

TWELVE = range(8, 97, 8)

#: N, m; dense entries from forward starts, adaptive and uniform, then from the nearer half.
EVERY_MTH = [
    (50, 2, 27853, 41503, 21469, 35119),
    (50, 4, 13930, 20482, 10990, 17542),
    (50, 8, 7504, 11032, 5782, 9310),
    (100, 2, 108178, 161728, 82278, 135828),
    (100, 4, 55153, 82453, 41685, 68985),
    (100, 8, 27580, 40684, 21364, 34468),
]


@pytest.mark.parametrize(
    ("rule", "segmentation", "expected"),
    [
        ("forward", "adaptive", (91, 2080, 27580, 24966)),
        ("forward", "uniform", (91, 3952, 40684, 36822)),
        ("nearest", "adaptive", (91, 2080, 21364, 19344)),
        ("nearest", "uniform", (91, 3952, 34468, 31200)),
    ],
)
def test_twelve_outages_on_a_hundred_segments_have_the_sizes_of_the_table(rule, segmentation, expected):
    assert tuple(sizes(100, TWELVE, segmentation, rule)) == expected


def test_flying_the_missed_segment_again_adds_three_columns_per_outage():
    assert sizes(100, TWELVE, "adaptive", "kept")[:3] == (91, 2116, 21616)
    assert sizes(100, TWELVE, "uniform", "kept")[:3] == (91, 3952, 34468)


@pytest.mark.parametrize(("n_segments", "m", *"abcd"), EVERY_MTH)
def test_densities_with_an_outage_at_every_mth_segment_are_those_of_the_table(n_segments, m, a, b, c, d):
    assert density_curve(m, [n_segments], "adaptive", "forward").tolist() == [a]
    assert density_curve(m, [n_segments], "uniform", "forward").tolist() == [b]
    assert density_curve(m, [n_segments], "adaptive", "nearest").tolist() == [c]
    assert density_curve(m, [n_segments], "uniform", "nearest").tolist() == [d]


@pytest.mark.parametrize(
    ("m", "millions"),
    [(2, (10.53, 15.79, 7.91, 13.17)), (4, (5.28, 7.91, 3.96, 6.60)), (8, (2.65, 3.97, 1.99, 3.31))],
)
def test_densities_on_a_thousand_segments_are_those_of_the_table(m, millions):
    kinds = [(kind, rule) for rule in ("forward", "nearest") for kind in ("adaptive", "uniform")]
    found = [density_curve(m, [1000], *kind)[0] / 1e6 for kind in kinds]
    assert found == pytest.approx(millions, abs=0.005)  # digits given


@pytest.mark.parametrize(
    ("n_segments", "m", "segmentation", "mark", "share"),
    [
        (100, 8, "adaptive", 16332, 0.005),
        (100, 8, "uniform", 36777, 0.005),
        # The mark of the experiments, whose spacing is a guess.
        (50, 4, "adaptive", 8859, 0.015),
    ],
)
def test_the_published_rule_meets_the_marks_of_the_figure(n_segments, m, segmentation, mark, share):
    found = density_curve(m, [n_segments], segmentation, "published")
    assert found.tolist() == pytest.approx([mark], rel=share)  # as well as marks can be read


def test_the_published_rule_is_counted_by_hand_on_twelve_segments():
    # n = 0, 4, 8, 12: all adaptive realizations have the least of 10 segments; min(n, 12 - n) = 0, 4, 4, 0.
    assert density_curve(4, [12], "adaptive", "published")[0] == 7 * (40 + 4 * 34 + 16 + 3 * 8)
    assert density_curve(4, [12], "uniform", "published")[0] == 7 * (40 + 4 * 40 + 16 + 3 * 8)


@pytest.mark.parametrize(("segments", "n_variables", "sparse", "dense"), CASES)
def test_the_cases_of_the_paper_have_the_sizes_counted_by_hand(segments, n_variables, sparse, dense):
    assert tuple(sizes(50, segments)) == (7 * (1 + len(segments)), n_variables, dense, sparse)


def columns_of_trajectories(stored):
    """Count the columns with an entry in the rows of each trajectory, times seven."""
    return 7 * sum(len(np.unique(stored[i : i + 7].nonzero()[1])) for i in range(0, stored.shape[0], 7))


@pytest.mark.parametrize("segmentation", ["adaptive", "uniform"])
@pytest.mark.parametrize(
    ("n_segments", "segments"),
    [
        (50, ()), (50, (4, 26, 48)), (50, (25, 26, 27, 49)), (50, range(4, 50, 4)), (51, (1, 26, 27, 50)),
        (7, (1, 3, 4, 5, 6)), (2, (1,)), (100, TWELVE),
    ],
)  # fmt: skip
def test_formulas_count_what_the_transcription_stores(n_segments, segments, segmentation):
    stored = pattern(problem(tuple((n, 1.0) for n in segments), n_segments, segmentation))
    counted = sizes(n_segments, segments, segmentation)
    assert stored.shape == (counted.n_rows, counted.n_variables)
    assert (stored.nnz, columns_of_trajectories(stored)) == (counted.sparse, counted.dense)


@pytest.mark.parametrize(
    ("segments", "segmentation"),
    [((12, 26, 40), "adaptive"), ((12, 26, 40), "uniform"), ((4, 48), "adaptive")],
)
def test_the_jacobian_has_the_pattern_and_the_counts(segments, segmentation):
    asked = problem(tuple((n, 1.0) for n in segments), 50, segmentation)
    flown = transcribe(asked)
    jacobian, stored = flown.jacobian(np.mean(flown.bounds, axis=0)), pattern(asked)
    assert jacobian.nnz == stored.nnz == sizes(50, segments, segmentation).sparse
    assert np.array_equal(jacobian.indptr, stored.indptr)
    assert np.array_equal(np.sort(jacobian.indices), np.sort(stored.indices))
    assert {True} == set(stored.data.tolist())


def test_dense_rows_fill_less_of_the_matrix_with_each_outage():
    filled = [sizes(50, segments).filled for segments in ((), (4,), (4, 8), (4, 8, 12))]
    assert filled[0] == 1.0 and filled == sorted(filled, reverse=True)


def test_entries_grow_with_the_square_of_the_number_of_segments():
    # Doubling N doubles both the outages and the columns of each.
    found = density_curve(4, [4000, 8000])
    assert found[1] / found[0] == pytest.approx(4.0, rel=2e-3)  # the next order is 1/N


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((50, [0]), r"segments: expected 1 .. 50, got 0"),
        ((50, [51]), r"segments: expected 1 .. 50, got 51"),
        ((1, []), "n_segments: expected at least 2, got 1"),
        ((50, [4], "even"), "segmentation: expected one of adaptive, uniform, got 'even'"),
        ((50, [4], "uniform", "published"), "rule: expected one of nearest, forward, kept, got 'published'"),
    ],
)
def test_counts_that_make_no_sense_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        dense_entries(*arguments)


def test_a_curve_without_a_spacing_is_refused():
    with pytest.raises(ValueError, match="m: expected at least 1, got 0"):
        density_curve(0, [50])
