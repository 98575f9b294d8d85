"""Guesses made from seeds: what each mapping keeps, what it leaves open, and what it refuses."""

import numpy as np
import pytest

from core.search import MAPPINGS, map_seed
from core.search.mapping import outage_profiles
from core.transcription import Transcription, layout_of, throttle_of, transcribe
from tests.core.known import solution
from tests.core.search.seeds import ONE, robust_solution
from tests.core.transcription.points import PRESET, UNITS, problem, random_point, transcription

SEED = solution()
#: One missed segment that thrusts in full and one that coasts in the known solution.
LIT, UNLIT = 8, 24


def trajectories(outages, **options):
    return layout_of(problem(outages, **options)).trajectories


def test_the_default_mapping_flies_the_controls_after_the_missed_segment():
    guess = map_seed(PRESET, SEED, problem(((12, 1.0), (40, 1.5))), "reference")
    reference, *realizations = trajectories(((12, 1.0), (40, 1.5)))
    np.testing.assert_array_equal(guess.x[: reference.stop], SEED)
    assert guess.states is None
    for n, own in zip((12, 40), realizations, strict=True):
        np.testing.assert_array_equal(guess.x[own.controls], SEED[3 + 3 * n : 153])
        assert guess.x[own.initial_coast] == 0.0
        assert guess.x[own.shooting_time] == pytest.approx(SEED[0] * (50 - n) / 50, abs=1e-13)  # rounding
        assert (guess.x[own.final_coast], guess.x[own.final_mass]) == (SEED[2], SEED[153])


def test_the_default_mapping_uses_no_realization_of_its_seed():
    one = problem(((12, 1.0),))
    seed = np.concatenate([SEED, np.full(layout_of(one).n_variables - 154, 77.0)])
    guess = map_seed(one, seed, problem(((12, 1.0), (40, 1.5))), "reference")
    np.testing.assert_array_equal(
        guess.x, map_seed(PRESET, SEED, problem(((12, 1.0), (40, 1.5))), "reference").x
    )


def test_other_numbers_of_segments_keep_the_impulse():
    outages, options = ((12, 1.0),), {"segmentation": "uniform"}
    seed_problem = problem((), **options)
    x = random_point(transcription(), 1)
    guess = map_seed(seed_problem, x, problem(outages, **options), "reference")
    own = trajectories(outages, **options)[1]
    assert own.n_segments == 50
    # 38 controls over 38 shares of time against 50 over the same: the mean thrust vector is the same.
    mean = throttle_of(guess.x[own.controls].reshape(-1, 3)).mean(axis=0)
    assert mean == pytest.approx(throttle_of(x[39:153].reshape(-1, 3)).mean(axis=0), abs=1e-14)  # rounding


def lifted_defects(outages, profiles=(), seed=SEED, n_legs=50):
    """Return the defects by (trajectory, boundary) of the aligned guess, with a node at every boundary."""
    target = Transcription(problem(outages), n_legs, 1e-12, profiles)
    z = target.lift(map_seed(PRESET, seed, problem(outages), "aligned"))
    return target, z, target.evaluate(target.lifted, z, False)[0].reshape(-1, 7)


#: What may remain where two arcs of the seed meet: the seed's own defect, 0.2 km of 384,400, as stored; and
#: arcs flown at the default tolerance, 3e-10 each.
CLOSED = 1e-6


def test_an_aligned_guess_is_open_in_the_first_leg_alone():
    target, _, defects = lifted_defects(((LIT, 1.0),))
    first = target.lifted.matchpoints[0] + 1
    others = np.delete(defects, first, axis=0)
    assert np.abs(others).max() < CLOSED
    assert np.linalg.norm(defects[first, 3:6]) > 0.01  # 10 m/s: two days of 3 N are 38


def test_the_first_leg_of_an_aligned_guess_misses_the_impulse_of_the_segment():
    target, _, defects = lifted_defects(((LIT, 1.0),))
    missed = defects[target.lifted.matchpoints[0] + 1] * UNITS
    control = SEED[3 * LIT : 3 * LIT + 3]
    burnt = control[0] * 3.0 * SEED[0] / 50 * 86400.0 / (2708.0 * 9.806)
    assert missed[6] == pytest.approx(
        burnt, abs=1e-6
    )  # it weighs more by what it did not burn; 1e-10 of 13 t
    # Earlier minus later: the impulse is missing. Gravity bends it within four days by up to a half.
    impulse = 3.0e-3 * SEED[0] / 50 * 86400.0 / 13100.0 * throttle_of(control[None, :])[0]
    assert missed[3:6] @ impulse < -0.5 * impulse @ impulse


def test_an_aligned_guess_has_no_defect_where_the_seed_coasts():
    _, _, defects = lifted_defects(((UNLIT, 1.0), (36, 1.5)))
    assert np.abs(defects).max() < CLOSED


def test_an_aligned_guess_keeps_the_epochs_of_its_seed():
    guess = map_seed(PRESET, SEED, problem(((LIT, 1.0),)), "aligned")
    own = trajectories(((LIT, 1.0),))[1]
    # The coast after the outage lasts until the missed segment would have ended.
    assert guess.x[own.initial_coast] == pytest.approx(SEED[0] / 50 - 1.0, abs=1e-12)
    assert guess.x[own.shooting_time] == pytest.approx(SEED[0] * (50 - LIT) / 50, abs=1e-12)
    assert guess.x[own.final_coast] == SEED[2]
    np.testing.assert_array_equal(guess.x[own.controls], SEED[3 + 3 * LIT : 153])
    for states, trajectory in zip(guess.states, trajectories(((LIT, 1.0),)), strict=True):
        assert states.shape == (trajectory.n_segments + 1, 7)
    np.testing.assert_array_equal(guess.states[1][0], guess.states[0][LIT])


def test_an_outage_of_several_segments_drops_them_all():
    guess = map_seed(PRESET, SEED, problem(((20, 5.0),)), "aligned")
    own = trajectories(((20, 5.0),))[1]
    # Three of 1.8 d each.
    assert guess.x[own.initial_coast] == pytest.approx(3 * SEED[0] / 50 - 5.0, abs=1e-12)
    assert guess.x[own.shooting_time] == pytest.approx(SEED[0] * 28 / 50, abs=1e-12)
    mean = throttle_of(guess.x[own.controls].reshape(-1, 3)).mean(axis=0)
    assert mean == pytest.approx(throttle_of(SEED[69:153].reshape(-1, 3)).mean(axis=0), abs=1e-12)


def test_realizations_that_the_seed_knows_are_kept():
    known, more = ((LIT, 1.0),), ((LIT, 1.0), (36, 1.0))
    seed = map_seed(PRESET, SEED, problem(known), "aligned").x
    guess = map_seed(problem(known), seed, problem(more), "aligned")
    own = trajectories(more)[1]
    np.testing.assert_array_equal(guess.x[own.offset : own.stop], seed[154:])
    assert np.isfinite(guess.states[2]).all()


@pytest.mark.parametrize("outages", [((LIT, 1.0),), ((LIT, 1.5), (36, 1.0))])
def test_at_depth_zero_the_reference_of_the_seed_solves_the_problem(outages):
    profiles = outage_profiles(problem(outages), PRESET, SEED, 0.0)
    _, _, defects = lifted_defects(outages, profiles)
    assert np.abs(defects).max() < CLOSED


def test_at_depth_one_nothing_is_flown_of_the_missed_segment():
    outages = ((LIT, 1.0), (20, 5.0))
    profiles = outage_profiles(problem(outages), PRESET, SEED, 1.0)
    assert [len(profile) for profile in profiles] == [1, 3]
    assert all(control[0] == 0.0 for profile in profiles for _, control in profile)
    halfway = outage_profiles(problem(outages), PRESET, SEED, 0.25)
    assert halfway[0][0][1] == pytest.approx([0.75 * SEED[24], SEED[25], SEED[26]], abs=1e-15)


@pytest.mark.parametrize(
    ("known", "wanted", "mapping", "message"),
    [
        (PRESET, problem(((8, 1.0),)), "closest", "expected all, nearest or one of reference, .* 'closest'"),
        (problem((), 49), problem(((8, 1.0),)), "aligned", "differs in its outages alone"),
        (problem(((8, 1.0), (9, 1.0))), problem(((8, 1.0),)), "aligned", "at most 1 outages, got 2"),
    ],
)
def test_a_seed_that_does_not_fit_is_refused(known, wanted, mapping, message):
    with pytest.raises(ValueError, match=message):
        map_seed(known, np.zeros(layout_of(known).n_variables), wanted, mapping)


@pytest.mark.parametrize("mapping", MAPPINGS)
@pytest.mark.parametrize("x", [np.zeros(153), np.full(154, np.nan)])
def test_a_seed_of_another_shape_or_without_a_number_is_refused(mapping, x):
    with pytest.raises(ValueError, match="decision vector: expected"):
        map_seed(PRESET, x, problem(((8, 1.0),)), mapping)


@pytest.mark.parametrize("mapping", MAPPINGS)
def test_mapped_guesses_lie_inside_the_bounds(mapping):
    asked = problem(((4, 1.0), (20, 5.0), (48, 1.0)))
    lower, upper = transcribe(asked).bounds
    x = map_seed(PRESET, SEED, asked, mapping).x
    slack = 1e-12 * (upper - lower)  # rounding of shares of the time
    assert np.all((x >= lower - slack) & (x <= upper + slack))


#: What a seed of P_1 has: a realization of 26 segments, with a recovery of its own.
ROBUST = robust_solution()


def realization(x, outages, number=1):
    """Return times [days], throttle vectors and final mass of a realization."""
    own = trajectories(outages)[number]
    return x[own.offset : own.offset + 3], throttle_of(x[own.controls].reshape(-1, 3)), x[own.final_mass]


OLD_TIMES, OLD_THROTTLES, OLD_MASS = realization(ROBUST, ((24, 1.0),))


def test_a_later_outage_flies_the_last_controls_of_its_source():
    outages = ((12, 1.0), (40, 1.0))
    guess = map_seed(ONE, ROBUST, problem(outages), "reference(0,1)")
    times, throttles, mass = realization(guess.x, outages, 2)
    np.testing.assert_array_equal(throttles, OLD_THROTTLES[16:])  # ten segments are left after 40
    assert times == pytest.approx([OLD_TIMES[0] * 10 / 26, 0.0, OLD_TIMES[2]], abs=1e-12)  # rounding
    assert mass == OLD_MASS
    default = map_seed(ONE, ROBUST, problem(outages), "reference").x
    own = trajectories(outages)[1]
    np.testing.assert_array_equal(guess.x[: own.stop], default[: own.stop])


def test_an_earlier_outage_flies_all_the_impulse_of_its_source():
    outages = ((8, 1.0), (40, 1.0))
    times, throttles, mass = realization(map_seed(ONE, ROBUST, problem(outages), "reference(1,1)").x, outages)
    assert (len(throttles), times[0], times[1], mass) == (42, OLD_TIMES[0], 0.0, OLD_MASS)
    # 42 parts of the time in place of 26: the sums of the thrust over time are the same.
    assert throttles.mean(axis=0) == pytest.approx(OLD_THROTTLES.mean(axis=0), abs=1e-14)
    assert throttles[0] == pytest.approx(OLD_THROTTLES[0], abs=1e-14)


def test_later_controls_are_averaged_over_other_numbers_of_segments():
    options = {"segmentation": "uniform"}
    seed_problem, asked = problem(((24, 1.0),), **options), problem(((37, 1.0), (40, 1.0)), **options)
    x = random_point(transcribe(seed_problem), 1)
    guess = map_seed(seed_problem, x, asked, "reference(1,1)")
    old, own = layout_of(seed_problem).trajectories[1], layout_of(asked).trajectories[1]
    before, after = (throttle_of(v[t.controls].reshape(-1, 3)) for v, t in ((x, old), (guess.x, own)))
    # After 37 there is half the time that there is after 24: two segments for each of the last 25.
    np.testing.assert_allclose(after, np.repeat(before[25:], 2, axis=0), rtol=0, atol=1e-12)  # rounding


@pytest.mark.parametrize(("days", "left"), [(1.0, OLD_TIMES[1]), (3.5, OLD_TIMES[1] - 2.5), (15.0, 0.0)])
def test_a_longer_outage_takes_its_time_from_the_coast_that_follows(days, left):
    outages = ((24, days), (40, 1.0))
    times, throttles, _ = realization(map_seed(ONE, ROBUST, problem(outages), "reference(1,0)").x, outages)
    assert times == pytest.approx([OLD_TIMES[0], left, OLD_TIMES[2]], abs=1e-12)  # rounding
    np.testing.assert_array_equal(throttles, OLD_THROTTLES)
    if days > 1.0:
        deeper = map_seed(ONE, ROBUST, problem(((24, days),)), "reference").x
        np.testing.assert_array_equal(realization(deeper, ((24, days),))[0], times)


@pytest.mark.parametrize("mapping", ["reference(1,0)", "aligned", "aligned(1,0)", "continued"])
def test_a_realization_is_returned_for_its_own_outage(mapping):
    guess = map_seed(ONE, ROBUST, problem(((24, 1.0), (40, 1.0))), mapping)
    np.testing.assert_array_equal(guess.x[: len(ROBUST)], ROBUST)


@pytest.mark.parametrize("mapping", ["{}", "{}(0,0,0)", "{}(1,2,1)", "{}(2,1,2)", "{}(nearest)"])
@pytest.mark.parametrize("form", MAPPINGS)
@pytest.mark.parametrize("coast", [0.0, 1.0])
def test_guesses_from_any_realization_lie_inside_the_bounds(form, mapping, coast):
    seed_problem, asked = problem(((4, 1.0), (44, 1.5))), problem(((2, 1.5), (24, 1.0), (48, 20.0)))
    flown = transcribe(seed_problem)
    x = random_point(flown, 5)
    for place in (t.initial_coast for t in flown.layout.trajectories[1:]):
        x[place] = coast * flown.bounds[1][place]  # up to coasts that outlast what later outages leave
    guess, (lower, upper) = map_seed(seed_problem, x, asked, mapping.format(form)), transcribe(asked).bounds
    slack = 1e-12 * (upper - lower)  # rounding of shares of the time
    assert np.all((guess.x >= lower - slack) & (guess.x <= upper + slack))
    if form != "reference":
        shapes = [(t.n_segments + 1, 7) for t in layout_of(asked).trajectories]
        assert [states.shape for states in guess.states] == shapes


def test_a_mapping_that_stands_for_several_is_refused():
    with pytest.raises(ValueError, match="expected one that makes one guess, got 'all', which makes 2"):
        map_seed(ONE, ROBUST, problem(((8, 1.0), (24, 1.0))), "all")
