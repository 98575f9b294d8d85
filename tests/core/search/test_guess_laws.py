"""Where guesses come from: inside the box, and spread as their law says."""

import numpy as np
import pytest
from scipy.stats import kstest

from core.search import GUESS_LAWS, hopping, sample_guess
from core.transcription import ReferencePath, throttle_of
from tests.core.transcription.points import transcription

FLOW = 3.0 * 86400.0 / (2708.0 * 9.806)  # kg per day at throttle 1


def flown(outages=((12, 1.0), (40, 1.0))):
    return transcription(outages)


@pytest.mark.parametrize("law", GUESS_LAWS)
def test_guesses_lie_inside_the_box(law):
    lower, upper = flown().sampling_box
    for rng_seed in range(20):
        x = sample_guess(flown(), np.random.default_rng(rng_seed), law)
        assert x.shape == lower.shape and np.all((x >= lower) & (x <= upper))


@pytest.mark.parametrize("law", GUESS_LAWS)
def test_the_same_generator_gives_the_same_guess(law):
    first, again = (sample_guess(flown(), np.random.default_rng(9), law) for _ in range(2))
    other = sample_guess(flown(), np.random.default_rng(10), law)
    assert np.array_equal(first, again) and not np.array_equal(first, other)


def test_uniform_guesses_fill_the_box_evenly():
    lower, upper = flown().sampling_box
    rng = np.random.default_rng(11)
    shares = np.array([(sample_guess(flown(), rng) - lower) / (upper - lower) for _ in range(200)])
    # A sample of the law itself passes with probability 1 - 1e-4.
    assert kstest(shares.ravel(), "uniform").pvalue > 1e-4
    assert kstest(shares[:, 0], "uniform").pvalue > 1e-4
    assert np.abs(shares.mean(axis=0) - 0.5).max() < 5 * 0.29 / np.sqrt(200)  # five deviations


def test_a_guess_of_the_flagship_is_what_it_was_before_the_dry_mass_became_a_bound():
    x = sample_guess(transcription(()), np.random.default_rng(2026))
    share = np.random.default_rng(2026).random(154)[-1]
    assert x[-1] == 1.0 + (13276.044404730972 - 1.0) * share


@pytest.fixture(scope="module")
def burns():
    return [sample_guess(flown(), np.random.default_rng(seed), "thrust-coast-thrust") for seed in range(12)]


def throttles(x):
    return x[flown().layout.reference.controls].reshape(-1, 3)[:, 0]


def test_thrust_coast_thrust_burns_at_both_ends_alone(burns):
    for x in burns:
        lit = np.flatnonzero(throttles(x))
        # Two runs at most: one from the first segment, one to the last, each within its half.
        gaps = np.flatnonzero(np.diff(np.concatenate([[-1], lit, [50]])) > 1)
        assert len(gaps) <= 1
        assert np.all(throttles(x)[lit] >= 0.5)
    assert 0 < sum(np.count_nonzero(throttles(x)) for x in burns) < 12 * 50


def test_thrust_coast_thrust_arrives_with_what_its_burns_leave(burns):
    for x in burns:
        left = 13276.044404730972 - FLOW * x[0] / 50 * throttles(x).sum()
        assert x[flown().layout.reference.final_mass] == pytest.approx(left, abs=1e-8)  # rounding


def angles_to_velocity(x):
    """Return the angle between control and velocity where its half enters each segment [rad]."""
    path, match = ReferencePath(flown(), x), flown().layout.reference.matchpoint
    aim = path.controls * [0.0, 1.0, 1.0] + [1.0, 0.0, 0.0]
    ahead = np.array([path.boundaries[p - 1 if p < match else p, 3:6] for p in range(1, 51)])
    cosines = np.sum(throttle_of(aim) * ahead, axis=1) / np.linalg.norm(ahead, axis=1)
    return np.arccos(np.clip(cosines, -1.0, 1.0))


def test_thrust_coast_thrust_points_along_the_velocity(monkeypatch):
    monkeypatch.setattr(hopping, "CONE_RAD", 0.0)
    for rng_seed in range(3):
        x = sample_guess(flown(), np.random.default_rng(rng_seed), "thrust-coast-thrust")
        assert angles_to_velocity(x).max() < 1e-6  # the root of rounding, as acos has it near 1


def test_thrust_coast_thrust_spreads_its_angles(burns):
    spread = np.concatenate([angles_to_velocity(x) for x in burns])
    # Two normal angles of 0.3 rad: a Rayleigh median of 0.353; less where the elevation shortens the azimuth.
    assert 0.25 < np.median(spread) < 0.40


def test_thrust_coast_thrust_lets_realizations_fly_the_controls_of_the_reference(burns):
    reference, early, _ = flown().layout.trajectories
    for x in burns:
        np.testing.assert_array_equal(x[early.controls], x[reference.control(13) : reference.final_mass])
        assert x[early.initial_coast] == 0.0


def test_an_unknown_law_is_refused():
    with pytest.raises(ValueError, match=r"guess law: expected one of uniform, .*, got 'normal'"):
        sample_guess(flown(), np.random.default_rng(0), "normal")
