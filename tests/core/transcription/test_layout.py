"""Sizes and sparsity against the tables of the paper's cases, worked out by hand; bounds; refusals."""

import numpy as np
import pytest

from core.transcription import checked_vector, layout_of
from core.transcription.builder import build_plan
from tests.core.transcription.points import PRESET, problem

P0 = ((),)
#: Cases, number of variables, non-zeros with sparse mass rows, and dense ones (whole columns of 7).
#: The reference has 3N + 4 columns; an early realization adds 2 + 3(n-1) of the reference and 3(N-n) + 4 own,
#: a late one 4 + 3(N-n+1) and 3(N-n) + 4; mass rows hold throttles, T_s and m_f alone.
CASES = [
    ([], 154, 976, 1078),
    ([4], 296, 1946, 2149),
    ([8], 284, 1946, 2149),
    ([12], 272, 1946, 2149),
    ([16], 260, 1946, 2149),
    ([20], 248, 1946, 2149),
    ([24], 236, 1946, 2149),
    ([26], 230, 1946, 2149),
    ([32], 212, 1731, 1911),
    ([40], 188, 1427, 1575),
    ([48], 164, 1123, 1239),
    ([4, 48], 306, 2093, 2310),
    ([12, 40], 306, 2397, 2646),
    ([20, 32], 306, 2701, 2982),
    ([4, 12], 414, 2916, 3220),
    ([8, 16], 390, 2916, 3220),
    ([12, 20], 366, 2916, 3220),
    ([4, 24, 48], 388, 3063, 3381),
    ([4, 26, 48], 382, 3063, 3381),
    ([12, 24, 40], 388, 3367, 3717),
    ([12, 26, 40], 382, 3367, 3717),
    ([4, 8, 12], 544, 3886, 4291),
    ([4, 12, 20], 508, 3886, 4291),
]


def structure_of(segments, n_segments=50, segmentation="adaptive"):
    asked = problem(tuple((n, 1.0) for n in segments), n_segments, segmentation)
    return layout_of(asked), build_plan(asked, layout_of(asked))


def dense_entries(structure):
    """Count whole columns of seven per trajectory, as if no mass partial were known to vanish."""
    pairs = set(zip((structure.rows // 7).tolist(), structure.columns.tolist(), strict=True))
    return 7 * len(pairs)


@pytest.mark.parametrize(("segments", "n_variables", "sparse", "dense"), CASES)
def test_sizes_of_the_cases_of_the_paper_are_those_counted_by_hand(segments, n_variables, sparse, dense):
    layout, structure = structure_of(segments)
    assert layout.n_variables == structure.n_variables == n_variables
    assert len(structure.plan.block_plus) == 1 + len(segments)
    assert (len(structure.rows), dense_entries(structure)) == (sparse, dense)


@pytest.mark.parametrize(
    ("n_segments", "every", "adaptive", "uniform"),
    [(50, 4, 10990, 17542), (50, 8, 5782, 9310), (100, 4, 41685, 68985), (100, 8, 21364, 34468)],
)
def test_dense_entries_with_outages_at_every_mth_segment(n_segments, every, adaptive, uniform):
    segments = range(every, n_segments, every)
    for segmentation, expected in (("adaptive", adaptive), ("uniform", uniform)):
        _, structure = structure_of(segments, n_segments, segmentation)
        # An outage at N itself leaves nothing to fly; the published count has one where M divides N.
        last = 7 * (4 + 3 + 3 * (n_segments if segmentation == "uniform" else 0) + 4)
        missing = last if n_segments % every == 0 else 0
        assert dense_entries(structure) == expected - missing


def test_twelve_outages_on_a_hundred_segments_have_the_published_sizes():
    for segmentation, n_variables, sparse in (("adaptive", 2080, 19344), ("uniform", 3952, 31200)):
        layout, structure = structure_of(range(8, 97, 8), 100, segmentation)
        assert (layout.n_variables, len(structure.rows)) == (n_variables, sparse)
        assert 7 * len(structure.matchpoints) == 91


def test_no_entry_is_listed_twice():
    _, structure = structure_of([1, 12, 26, 27, 49])
    pairs = set(zip(structure.rows.tolist(), structure.columns.tolist(), strict=True))
    assert len(pairs) == len(structure.rows)


def test_variables_stand_in_the_order_of_the_paper():
    layout, _ = structure_of([48, 12])
    reference, early, late = layout.trajectories
    assert (reference.shooting_time, reference.initial_coast, reference.final_coast) == (0, 1, 2)
    assert (reference.control(1), reference.control(50), reference.final_mass) == (3, 150, 153)
    assert (early.offset, early.n_segments, early.final_mass) == (154, 38, 154 + 3 + 3 * 38)
    assert (late.offset, late.n_segments, late.stop) == (272, 2, 282)
    assert (reference.matchpoint, early.matchpoint, late.matchpoint) == (26, 20, 2)


def test_bounds_are_the_box_of_the_paper_with_a_share_of_the_time_for_a_realization():
    lower, upper = layout_of(problem(((30, 1.0),))).bounds(PRESET, 13276.0)
    assert (lower[:3].tolist(), upper[:3].tolist()) == ([1e-3, 0, 0], [90, 30, 30])
    assert upper[3:6] == pytest.approx([1, np.pi, np.pi / 2], abs=0) and lower[3] == 0
    np.testing.assert_array_equal(lower[4:6], -upper[4:6])
    # The dry mass, which is more than the 1 kg of the box.
    assert (lower[153], lower[-1], upper[153]) == (5000.0, 5000.0, 13276.0)
    # 20 of 50 segments remain.
    assert upper[154:157] == pytest.approx([36.0, 30.0, 30.0], abs=1e-13)
    assert lower[154:157] == pytest.approx([4e-4, 0.0, 0.0], abs=1e-18)
    assert np.all(lower < upper)


def test_the_box_that_guesses_are_drawn_from_does_not_depend_on_the_dry_mass():
    asked = problem(((30, 1.0),))
    heavier = asked.model_copy(
        update={"spacecraft": asked.spacecraft.model_copy(update={"dry_mass_kg": 9e3})}
    )
    boxes = [layout_of(one).sampling_box(one, 13276.0) for one in (asked, heavier)]
    np.testing.assert_array_equal(*boxes)
    lower, upper = boxes[0]
    assert (lower[153], lower[-1], upper[153]) == (1.0, 1.0, 13276.0)
    bounds = layout_of(heavier).bounds(heavier, 13276.0)
    masses = lower != bounds[0]
    assert np.flatnonzero(masses).tolist() == [153, len(lower) - 1] and np.all(bounds[0][masses] == 9000.0)
    np.testing.assert_array_equal(bounds[1], upper)


@pytest.mark.parametrize(
    ("x", "message"),
    [
        (np.zeros(153), r"expected shape \(154,\) for 50 segments, k = 0, got \(153,\)"),
        (np.zeros((154, 1)), r"got \(154, 1\)"),
        (np.where(np.arange(154) == 3, np.nan, 0.0), "expected finite numbers, got 1 that are not"),
    ],
)
def test_a_vector_of_another_shape_or_without_a_number_is_refused(x, message):
    with pytest.raises(ValueError, match=message):
        checked_vector(layout_of(PRESET), x)
