"""The lifted form: the same guess, the same solutions, more matchpoints."""

import numpy as np
import pytest

from core.transcription import Guess, ReferencePath
from tests.core.partials import assert_partials
from tests.core.transcription.points import UNITS, random_point, transcription

OUTAGES = ((4, 1.0), (11, 1.0), (16, 1.0))


def lifted(n_legs=6, outages=OUTAGES):
    return transcription(outages, 20, "adaptive", n_legs)


def evaluate(flown, z):
    return flown.evaluate(flown.lifted, z, with_partials=False)[0].reshape(-1, 7)


@pytest.mark.parametrize("n_legs", [1, 2, 6, 20])
@pytest.mark.parametrize("outages", [(), OUTAGES, ((1, 1.0), (19, 1.0))])
def test_a_lifted_guess_has_defects_at_the_matchpoints_alone(n_legs, outages):
    flown = lifted(n_legs, outages)
    x = random_point(flown, 1)
    defects = evaluate(flown, flown.lift(x))
    matchpoints = list(flown.lifted.matchpoints)
    assert np.all(np.delete(defects, matchpoints, axis=0) == 0.0)  # the very same arithmetic
    np.testing.assert_allclose(
        defects[matchpoints].ravel(), flown.defects(x) / np.tile(UNITS, 1 + len(outages)), rtol=1e-13
    )


def test_dropping_the_nodes_gives_the_vector_back():
    x = random_point(lifted(), 2)
    # There and back between units: two roundings.
    np.testing.assert_allclose(lifted().drop_nodes(lifted().lift(x)), x, rtol=4e-16)


def test_every_column_of_the_lifted_jacobian_is_a_central_difference():
    flown = transcription(((3, 1.0), (6, 1.0), (8, 1.0)), 10, "adaptive", 5)
    rng = np.random.default_rng(3)
    z = flown.lift(random_point(flown, 3))
    z[flown.n_variables :] += 1e-2 * rng.standard_normal(len(z) - flown.n_variables)
    _, values = flown.evaluate(flown.lifted, z, with_partials=True)
    found = np.zeros((7 * len(flown.lifted.plan.block_plus), len(z)))
    found[flown.lifted.rows, flown.lifted.columns] = values
    # As for the plain form: joints of the target, magnified, over h.
    assert_partials(found, lambda p: evaluate(flown, p).ravel(), z, step=1e-4, rtol=1e-6, atol=2e-6, order=4)


def test_a_leg_begins_where_an_outage_does():
    boundaries = {boundary for trajectory, boundary in lifted().lifted.nodes if trajectory == 0}
    # 11 is the matchpoint, where both halves end anyway.
    assert {4, 16} <= boundaries and 11 not in boundaries


def test_more_legs_mean_more_nodes_and_seven_defects_each():
    for n_legs in (2, 5, 10, 20):
        flown = lifted(n_legs, ())
        # One boundary between legs is the matchpoint, if it lies on the grid.
        assert len(flown.lifted.nodes) in (n_legs - 1, n_legs - 2)
        assert flown.lifted.n_variables == flown.n_variables + 7 * len(flown.lifted.nodes)
        assert len(flown.lifted.plan.block_plus) == 1 + len(flown.lifted.nodes)


def test_a_node_where_the_outage_starts_leaves_nine_columns_of_the_reference():
    flown = transcription(((4, 1.0),), 20, "adaptive", 20)
    first = flown.lifted.matchpoints[0] + 1  # the first block of the realization
    coupled = set(flown.lifted.columns[flown.lifted.rows // 7 == first].tolist())
    node = flown.lifted.nodes[0, 4]
    assert set(range(node, node + 7)) <= coupled
    # Besides the node: T_s and T_i.
    assert coupled & set(range(flown.layout.reference.stop)) == {0, 1}


def test_states_that_a_guess_brings_start_the_nodes():
    flown = lifted(5, ())
    states = np.random.default_rng(4).random((21, 7))
    z = flown.lift(Guess(random_point(flown, 4), (states,)))
    for (_, boundary), place in flown.lifted.nodes.items():
        np.testing.assert_array_equal(z[place : place + 7], states[boundary - 1])


def test_states_that_are_missing_are_propagated_and_no_others():
    flown = lifted(6, OUTAGES)
    x = random_point(flown, 4)
    brought = np.random.default_rng(4).random((21, 7))
    gaps = brought.copy()
    gaps[::2] = np.nan
    z, free = flown.lift(Guess(x, (gaps, None, None, None))), flown.lift(x)
    defects = evaluate(flown, z)
    for (trajectory, boundary), place in flown.lifted.nodes.items():
        if trajectory == 0 and boundary % 2 == 0:
            np.testing.assert_array_equal(z[place : place + 7], brought[boundary - 1])
    assert np.isfinite(z).all() and np.any(z != free)
    # What was filled in joins its leg: as many blocks are closed as nodes were missing.
    brought_along = sum(trajectory == 0 and boundary % 2 == 0 for trajectory, boundary in flown.lifted.nodes)
    n_open = brought_along + 1 + len(OUTAGES)
    assert np.sum(np.any(defects != 0.0, axis=1)) <= n_open


@pytest.mark.parametrize("states", [None, (None,) * 4, (np.full((21, 7), np.nan),) * 4])
def test_without_any_state_a_guess_is_its_vector(states):
    flown = lifted(6, OUTAGES)
    x = random_point(flown, 4)
    np.testing.assert_array_equal(flown.lift(Guess(x, states)), flown.lift(x))


def test_the_states_of_a_lifted_vector_lift_it_again():
    flown = lifted(6, OUTAGES)
    x = random_point(flown, 4)
    z = flown.lift(x)
    z[flown.n_variables :] += 1e-3 * np.random.default_rng(1).standard_normal(len(z) - flown.n_variables)
    paths = tuple(flown.nodes_of(z, trajectory) for trajectory in range(4))
    np.testing.assert_array_equal(flown.lift(Guess(x, paths)), z)


def test_nodes_lie_on_the_path_of_the_reference():
    flown = lifted(20, ())
    x = random_point(flown, 5)
    z, path = flown.lift(x), ReferencePath(flown, x)
    # Epochs summed in another order, 1e-15 TU, magnified by a perilune passage.
    for (_, boundary), place in flown.lifted.nodes.items():
        np.testing.assert_allclose(z[place : place + 7], path.boundaries[boundary - 1], rtol=0, atol=1e-10)
