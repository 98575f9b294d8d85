"""Clusters and diverse choices against loops as naive as their definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from core.analysis.similarity import DISTINCT, clusters, distance, feature_rows, features, most_diverse
from core.problem import load_problem

PROBLEM = load_problem("ppe-drm3")
#: Multiples of a quarter are exact, and so are many distances between them: ties with the threshold abound.
GRIDS = hnp.arrays(
    np.float64,
    st.tuples(st.integers(0, 40), st.integers(1, 4)),
    elements=st.integers(-8, 8).map(lambda i: i / 4),
)
CLOUDS = hnp.arrays(
    np.float64, st.tuples(st.integers(0, 40), st.integers(1, 4)), elements=st.floats(-2.0, 2.0, width=32)
)


def naive(rows, threshold):
    representatives, found = [], []
    for row in rows:
        near = [np.linalg.norm(row - other) <= threshold for other in representatives]
        if not any(near):
            representatives.append(row)
            near.append(True)
        found.append(near.index(True))
    return found


@given(GRIDS | CLOUDS, st.sampled_from([0.0, 0.05, 0.25, 0.5, 1.0, 2.5, 10.0]))
def test_clusters_are_those_of_the_naive_loop(rows, threshold):
    assert clusters(rows, threshold).tolist() == naive(rows, threshold)


def test_clusters_do_not_depend_on_where_blocks_and_cells_end(monkeypatch):
    monkeypatch.setattr("core.analysis.similarity.BLOCK", 7)
    rng = np.random.default_rng(1)
    for width in (0.02, 0.1, 0.6):
        rows = rng.uniform(size=(200, 3))
        assert clusters(rows, width).tolist() == naive(rows, width)


def test_a_solution_joins_the_first_representative_and_not_the_nearest():
    # The third is 0.09 from the first and 0.02 from the second, and the fourth near the third alone.
    assert clusters(np.array([[0.0], [0.11], [0.09], [0.185]]), 0.1).tolist() == [0, 1, 0, 1]
    assert clusters(np.array([[0.0], [0.09], [0.18]]), 0.1).tolist() == [0, 0, 1]


def test_a_negative_threshold_is_refused():
    with pytest.raises(ValueError, match="threshold: expected a distance of at least 0, got -1"):
        clusters(np.zeros((2, 2)), -1.0)


def test_features_hold_times_over_widths_and_throttle_vectors_of_the_reference_alone():
    x = np.zeros(154)
    x[:3], x[3:6] = (45.0, 6.0, 20.0), (0.5, np.pi / 2, 0.0)
    row = features(PROBLEM, x)
    expected = np.zeros(152)
    expected[:2], expected[3] = (45.0 / 89.999, 6.0 / 30.0), 0.5 / np.sqrt(50)
    assert row == pytest.approx(expected, abs=1e-15)  # the cosine of pi/2 is 6e-17
    # Realizations and the final coast do not count.
    other = np.concatenate([x, np.ones(100)])
    other[2] = 1.0
    assert np.array_equal(features(PROBLEM, other), row)
    assert np.array_equal(feature_rows(PROBLEM, [other, x]), [row, row])


def test_distances_of_features_are_those_of_solutions():
    x = np.zeros(154)
    other = x.copy()
    other[0], other[3] = 0.06 * 89.999, 0.08 * np.sqrt(50)
    assert distance(PROBLEM, x, other) == pytest.approx(0.1, rel=1e-14)  # 0.06, 0.08, 0.1; rounding
    assert clusters(feature_rows(PROBLEM, [x, other])).tolist() == [0, 1]
    assert clusters(feature_rows(PROBLEM, [x, other]), 2.1 * DISTINCT).tolist() == [0, 0]
    assert feature_rows(PROBLEM, []).shape == (0, 152)


def test_a_vector_without_a_whole_reference_is_refused():
    with pytest.raises(ValueError, match="decision vector: expected 154 numbers of the reference, got 153"):
        features(PROBLEM, np.zeros(153))


@given(GRIDS | CLOUDS, st.integers(0, 50))
def test_each_diverse_choice_is_the_farthest_from_those_before(rows, n):
    chosen = most_diverse(rows, n)
    assert len(chosen) == len(set(chosen.tolist())) == min(n, len(rows))
    assert chosen[:1].tolist() == [0][: len(chosen)]
    for i in range(1, len(chosen)):
        nearest = [min(np.sum((rows[chosen[:i]] - row) ** 2, axis=1)) for row in rows]
        left = np.setdiff1d(np.arange(len(rows)), chosen[:i])
        best = max(nearest[j] for j in left)
        assert chosen[i] == next(j for j in left if nearest[j] == best)


def test_fewer_than_no_solutions_cannot_be_chosen():
    with pytest.raises(ValueError, match="number of solutions: expected at least 0, got -1"):
        most_diverse(np.zeros((2, 2)), -1)
