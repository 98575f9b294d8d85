"""Spherical controls against the closed form, and their way back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.transcription import control_of, throttle_of
from core.transcription.control import thrust_of
from tests.core.partials import assert_partials


def thrust(control, size=2.0):
    vector, partials = np.empty(3), np.empty((3, 3))
    thrust_of(np.asarray(control, dtype=float), size, vector, partials)
    return vector, partials


@pytest.mark.parametrize(
    ("control", "expected"),
    [
        ((1.0, 0.0, 0.0), (2, 0, 0)),
        ((0.5, np.pi / 2, 0.0), (0, 1, 0)),
        ((0.5, np.pi / 2, np.pi / 2), (0, 0, 1)),
        ((1.0, -np.pi / 2, 0.0), (0, -2, 0)),
        ((1.0, np.pi / 4, -np.pi / 6), (np.sqrt(1.5), np.sqrt(1.5), -1.0)),
    ],
)
def test_angles_are_azimuth_and_elevation(control, expected):
    assert thrust(control)[0] == pytest.approx(expected, abs=1e-15)  # rounding of pi
    assert throttle_of(np.array([control]))[0] == pytest.approx(np.array(expected) / 2.0, abs=1e-15)


@pytest.mark.parametrize("control", np.random.default_rng(3).uniform([0, -3, -1.5], [1, 3, 1.5], (5, 3)))
def test_partials_of_the_thrust_are_central_differences(control):
    # h^2/6 of sines: 2e-11; rounding eps/h = 2e-11.
    partials = thrust(control)[1].T
    assert_partials(partials, lambda u: thrust(u)[0], control, step=1e-5, rtol=0, atol=2e-10)


def test_without_throttle_both_angles_lose_their_effect():
    partials = thrust((0.0, 0.4, 0.3))[1]
    assert np.all(partials[1:] == 0.0)
    assert np.linalg.norm(partials[0]) == pytest.approx(2.0, abs=1e-15)  # rounding


@given(st.floats(1e-3, 1.0), st.floats(-np.pi + 1e-9, np.pi), st.floats(-np.pi / 2 + 1e-3, np.pi / 2 - 1e-3))
@settings(max_examples=100, deadline=None, derandomize=True)
def test_control_of_undoes_throttle_of(throttle, in_plane, out_of_plane):
    control = np.array([[throttle, in_plane, out_of_plane]])
    # Azimuth loses 1/cos(elevation) <= 1000 of rounding.
    np.testing.assert_allclose(control_of(throttle_of(control)), control, atol=1e-12)


def test_no_thrust_is_throttle_zero_with_angles_zero():
    assert control_of(np.zeros((2, 3))).tolist() == [[0, 0, 0], [0, 0, 0]]
