"""Defects against a second flight with SciPy and SPICE, and against what is known in closed form."""

import json
from pathlib import Path

import numpy as np
import pytest

from core.transcription import Guess
from core.verification.verify import verify
from tests.core.transcription.points import problem, random_point, transcription

#: A transfer with low passages, closed to 8 m in coarse tables of the bodies and off by 0.35 km in truth.
SENSITIVE = Path(__file__).parent / "sensitive.json"
FLOW = 3.0 * 86400.0 / (2708.0 * 9.806)  # kg per day at throttle 1: 9.761


@pytest.mark.parametrize(
    ("outages", "n_segments", "segmentation"),
    [
        ((), 50, "adaptive"),
        (((4, 1.0), (26, 0.5), (40, 1.5)), 50, "adaptive"),  # in front of, on and behind the matchpoint
        (((1, 1.0), (6, 9.0), (8, 1.0)), 9, "adaptive"),  # first segment, long outage, one segment left
        (((3, 1.0), (7, 2.0)), 9, "uniform"),
    ],
)
def test_defects_are_those_that_scipy_and_spice_find(outages, n_segments, segmentation):
    flown = transcription(outages, n_segments, segmentation)
    x = random_point(flown, 2)
    again = verify(problem(outages, n_segments, segmentation), x).defects
    found = flown.defects(x).reshape(-1, 7)
    # Metres: the verifier's tolerance and the joints of the orbit, 6e-7 km, magnified by lunar passages.
    np.testing.assert_allclose(found[:, :3], again[:, :3], rtol=0, atol=5e-3)
    np.testing.assert_allclose(found[:, 3:6], again[:, 3:6], rtol=0, atol=1e-7)
    np.testing.assert_allclose(found[:, 6], again[:, 6], rtol=0, atol=1e-8)


def test_defects_of_a_sensitive_path_are_those_that_scipy_and_spice_find():
    x = np.array(json.loads(SENSITIVE.read_text(encoding="utf-8")))
    again = verify(problem(), x).defects
    found = transcription(tolerance=1e-12).defects(x).reshape(-1, 7)
    # It magnifies 0.2 mm and 1e-10 km/s of the Moon to 0.35 km. Other integrators differ by 0.01 km.
    np.testing.assert_allclose(found[:, :3], again[:, :3], rtol=0, atol=0.05)


def mass_flown(x, trajectory, segments):
    """Return the kilograms burnt over some segments."""
    throttles = x[trajectory.controls].reshape(-1, 3)[segments, 0]
    return FLOW * x[trajectory.shooting_time] / trajectory.n_segments * throttles.sum()


def test_mass_defects_have_a_closed_form():
    flown = transcription(((4, 1.0), (40, 1.5)))
    x = random_point(flown, 4)
    reference, early, late = flown.layout.trajectories
    expected = [13276.044404730972 - mass_flown(x, reference, slice(0, 25))]
    # The early one starts with what is left after three segments, the late one with what the end still needs.
    expected.append(
        13276.044404730972 - mass_flown(x, reference, slice(0, 3)) - mass_flown(x, early, slice(0, 23))
    )
    at_40 = x[reference.final_mass] + mass_flown(x, reference, slice(39, 50))
    expected.append(at_40 - mass_flown(x, late, slice(0, 5)))
    for index, (trajectory, first) in enumerate(((reference, 25), (early, 23), (late, 5))):
        expected[index] -= x[trajectory.final_mass] + mass_flown(x, trajectory, slice(first, None))
    assert flown.defects(x)[6::7] == pytest.approx(expected, abs=1e-9)  # rounding


def test_a_final_coast_on_a_ballistic_target_leaves_the_defects_alone():
    flown = transcription()
    x = random_point(flown, 5)
    longer = x.copy()
    longer[2] += 0.5
    # The joints of the generated orbit, 6e-7 km, magnified by a perilune passage.
    np.testing.assert_allclose(flown.defects(longer)[:3], flown.defects(x)[:3], rtol=0, atol=1e-2)


def test_a_leg_more_or_less_does_not_change_the_defects():
    x = random_point(transcription(((12, 1.0),)), 6)
    one = transcription(((12, 1.0),)).defects(x)
    np.testing.assert_array_equal(transcription(((12, 1.0),), n_legs=7).defects(x), one)


def test_evaluating_is_pure():
    flown = transcription(((12, 1.0),))
    x = random_point(flown, 7)
    kept, first = x.copy(), flown.defects(x)
    flown.jacobian(np.mean(flown.bounds, axis=0))
    np.testing.assert_array_equal(flown.defects(x), first)
    np.testing.assert_array_equal(x, kept)


def test_a_guess_stands_wherever_a_vector_does():
    flown = transcription()
    x = random_point(flown, 8)
    np.testing.assert_array_equal(flown.defects(Guess(x)), flown.defects(x))


def test_what_cannot_be_flown_is_not_a_number():
    flown = transcription()
    x = random_point(flown, 9)
    x[0] = 400.0  # beyond the tables
    assert np.isnan(flown.defects(x)).all() and np.isnan(flown.jacobian(x).data).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_legs": 0}, "n_legs: expected an integer of at least 1, got 0"),
        ({"tolerance": 1.0}, r"tolerance: expected 1e-14 \.\. 1e-3, got 1\.0"),
    ],
)
def test_impossible_options_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        transcription(**options)
