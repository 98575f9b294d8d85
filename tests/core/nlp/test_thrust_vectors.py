"""What the descent moves: partials, masses of a start, longer starts, a reference that stands still."""

import numpy as np
import pytest

from core.nlp.descent import ThrustVectors, node_scales
from core.transcription import Guess
from tests.core.known import solution
from tests.core.partials import assert_partials
from tests.core.transcription.points import random_point, transcription

OUTAGES = ((3, 1.0), (7, 1.0))
DAY = 86400.0 / 375190.25852
#: What 3 N at 2708 s burn in a day of full throttle, g0 being the 9.806 m/s^2 of the preset [kg].
BURNT_PER_DAY = 3.0 / (2708.0 * 9.806) * 86400.0


def form(outages=OUTAGES, is_reference_fixed=False, n_segments=10, n_legs=4):
    return ThrustVectors(transcription(outages, n_segments, "adaptive", n_legs), is_reference_fixed)


def start(of, rng_seed=1):
    return of.start(random_point(of.transcription, rng_seed))


@pytest.mark.parametrize("is_reference_fixed", [False, True])
def test_every_column_is_a_central_difference(is_reference_fixed):
    of = form(is_reference_fixed=is_reference_fixed)
    z = start(of)
    z[of.transcription.n_variables :] += 1e-2 * np.random.default_rng(3).standard_normal(
        len(z) - of.transcription.n_variables
    )
    # As for the lifted form: joints of the target, magnified, over h.
    assert_partials(of.linearize(z)[1], of.defects, z, step=1e-4, rtol=1e-6, atol=2e-6, order=4)


def burnt_kg(of, z, trajectory, n_segments):
    lengths = np.linalg.norm(z[trajectory.controls].reshape(-1, 3)[:n_segments], axis=1)
    return BURNT_PER_DAY * z[trajectory.shooting_time] / DAY / trajectory.n_segments * lengths.sum()


def test_final_masses_of_a_start_are_what_its_throttles_leave():
    of = form()
    z = start(of)
    reference, *realizations = of.transcription.layout.trajectories
    departure = of.transcription.start_mass_kg
    found = z[reference.final_mass] * 15000.0
    assert found == pytest.approx(departure - burnt_kg(of, z, reference, 10), abs=1e-6)  # rounding of kg
    for trajectory, (segment, _) in zip(realizations, OUTAGES, strict=True):
        left = departure - burnt_kg(of, z, reference, segment - 1) - burnt_kg(of, z, trajectory, 99)
        assert z[trajectory.final_mass] * 15000.0 == pytest.approx(left, abs=1e-6)


def test_a_start_that_knows_its_states_keeps_its_final_mass():
    of = form(())
    x = random_point(of.transcription, 1)
    states = np.random.default_rng(4).random((11, 7))
    z = of.start(Guess(x, (states,)))
    assert z[of.transcription.layout.reference.final_mass] * 15000.0 == pytest.approx(x[-1], rel=1e-15)
    for (_, boundary), place in of.transcription.lifted.nodes.items():
        np.testing.assert_array_equal(z[place : place + 7], states[boundary - 1])


@pytest.mark.parametrize("is_reference_fixed", [False, True])
def test_a_longer_start_has_half_of_the_time_that_was_left_and_the_same_controls_and_coasts(
    is_reference_fixed,
):
    of = form(is_reference_fixed=is_reference_fixed)
    z = start(of)
    longer = of.lengthen(z)
    latest = of.transcription.bounds[1] * DAY
    for index, trajectory in enumerate(of.transcription.layout.trajectories):
        place = trajectory.shooting_time
        halfway = 0.5 * (z[place] + latest[place])
        expected = z[place] if index == 0 and is_reference_fixed else halfway
        assert longer[place] == pytest.approx(expected, abs=1e-6)  # the margin kept from bounds
        for kept in (trajectory.initial_coast, trajectory.final_coast, trajectory.controls):
            np.testing.assert_array_equal(longer[kept], z[kept])


def test_a_longer_start_is_flown_afresh_so_that_matchpoints_alone_are_open():
    of = form()
    defects = of.defects(of.lengthen(start(of))).reshape(-1, 7)
    matchpoints = list(of.transcription.vectors.matchpoints)
    assert np.all(np.delete(defects, matchpoints, axis=0) == 0.0)
    assert np.all(np.abs(defects[matchpoints, 6]) < 1e-12)  # rounding of a sum of masses
    assert np.all(np.abs(defects[matchpoints]).max(axis=1) > 1e-3)


def test_with_a_fixed_reference_the_rows_of_realizations_alone_count():
    free, fixed = form(), form(is_reference_fixed=True)
    z = start(free)
    n_reference = 7 * (1 + sum(trajectory == 0 for trajectory, _ in free.transcription.lifted.nodes))
    assert fixed.n_defects == free.n_defects - n_reference
    np.testing.assert_array_equal(fixed.defects(z), free.defects(z)[n_reference:])
    assert not np.any(fixed.free_controls[:10]) and np.all(fixed.free_controls[10:])


def test_lengths_of_a_step_are_those_of_times_masses_and_nodes():
    of = transcription(OUTAGES, 10, "adaptive", 4)
    scale = node_scales(of)
    for trajectory in of.layout.trajectories:
        np.testing.assert_array_equal(scale[trajectory.controls], 1.0)
        assert len(set(scale[trajectory.offset : trajectory.offset + 3])) == 1
    for place in of.lifted.nodes.values():
        np.testing.assert_array_equal(scale[place : place + 7], scale[-7:])
    assert scale.shape == (of.lifted.n_variables,) and np.all(scale > 0.0)


def test_times_beyond_their_bounds_come_back_inside():
    of = ThrustVectors(transcription(n_legs=10))
    z = of.start(solution())
    z[of.times] += np.array([10.0, -10.0, 10.0])
    x = of.decision(of.inside(z))
    lower, upper = of.transcription.bounds
    np.testing.assert_allclose(x[:3], [upper[0], lower[1], upper[2]], rtol=0, atol=1e-5)  # the margin, days
