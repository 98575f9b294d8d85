"""IPOPT with exact second derivatives: a closed point becomes the local optimum nearby."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.analysis.stationarity import stationarity
from core.nlp import Limits, no_stop
from core.nlp.descent import node_scales
from core.nlp.feasibility import close_finely
from core.nlp.ipopt import _Callbacks, polish
from core.tolerances import violation
from core.transcription import throttle_of, transcribe, wrapped
from tests.core.known import near, optimum, solution
from tests.core.partials import assert_partials
from tests.core.transcription.points import PRESET

angles = st.floats(-100.0, 100.0)


@pytest.fixture(scope="module")
def flown():
    return transcribe(PRESET, 20)


def limits(iterations=3000, cpu=60.0, stop=no_stop):
    return Limits(cpu, iterations, stop)


def test_a_disturbed_optimum_is_found_again(flown):
    lower, upper = flown.bounds
    layout = flown.layout.reference
    start = optimum()
    # The throttles that are neither full nor off, by a hundredth.
    places = np.arange(layout.controls.start, layout.controls.stop, 3)
    free = places[(start[places] > 0.05) & (start[places] < 0.95)]
    start[free] += 0.01
    found = polish(flown, close_finely(flown, start), limits())
    assert found.is_optimal and np.all((found.x >= lower) & (found.x <= upper))
    closed = close_finely(flown, found.x)
    assert violation(flown.at_tolerance(1e-12).defects(closed).reshape(-1, 7)) <= 1.0
    assert stationarity(flown, closed).is_optimal
    # The same optimum, or a better one: a gram for the defects that SLSQP left.
    assert closed[layout.final_mass] >= optimum()[layout.final_mass] - 1e-3


def test_a_solution_short_of_its_optimum_gains_mass(flown):
    found = polish(flown, solution(), limits())
    assert found.x is not None and found.x[-1] > solution()[-1] + 1.0


def test_limits_and_stops_are_obeyed(flown):
    few = limits(iterations=3)
    assert not polish(flown, solution(), few).is_optimal and few.iterations == 3
    stopped = limits(stop=lambda: True)
    assert not polish(flown, solution(), stopped).is_optimal and stopped.iterations <= 1
    late = limits(cpu=-1.0)
    assert not polish(flown, solution(), late).is_optimal and late.iterations <= 1


@given(st.floats(0.0, 1.0), angles, angles)
def test_angles_come_back_into_their_box_with_the_same_thrust(throttle, in_plane, out_of_plane):
    control = np.array([[throttle, in_plane, out_of_plane]])
    found = wrapped(control)
    assert abs(found[0, 1]) <= np.pi and abs(found[0, 2]) <= np.pi / 2
    assert found[0, 0] == throttle
    # Rounding of angles up to a hundred, twice.
    np.testing.assert_allclose(throttle_of(found), throttle_of(control), rtol=0, atol=1e-13)


@pytest.fixture
def callbacks():
    flown = transcribe(PRESET, 10, 1e-12)
    return _Callbacks(flown, limits(), node_scales(flown), 100)


def start(callbacks, rng_seed=1):
    return callbacks.transcription.lift(near(callbacks.transcription, rng_seed)) / callbacks.scale


def test_the_gradient_is_that_of_the_objective_and_points_to_less_mass(callbacks):
    w = start(callbacks)
    # Linear: rounding eps / h alone.
    assert_partials(callbacks.gradient(w), callbacks.objective, w, step=1e-3, rtol=0, atol=1e-11)
    assert callbacks.gradient(w)[callbacks.mass] < 0.0


def test_scaled_partials_are_those_of_the_scaled_defects(callbacks):
    w = start(callbacks)
    step = 1e-5 * np.random.default_rng(2).standard_normal(len(w))
    rows, columns = callbacks.jacobianstructure()
    expected = np.bincount(rows, callbacks.jacobian(w) * step[columns])
    change = 0.5 * (callbacks.constraints(w + step).copy() - callbacks.constraints(w - step))
    np.testing.assert_allclose(change, expected, rtol=0, atol=1e-4 * np.abs(expected).max())  # cube of h


def test_each_point_is_flown_once_however_often_it_is_asked_for(callbacks):
    w = start(callbacks)
    first = callbacks.constraints(w).copy()
    callbacks.constraints(w.copy())
    assert callbacks.limits.evaluations == 1
    callbacks.jacobian(w)
    callbacks.jacobian(w.copy())
    callbacks.constraints(w)
    assert callbacks.limits.evaluations == 2
    # With the partials the sums run in another order.
    np.testing.assert_allclose(callbacks.constraints(w), first, rtol=0, atol=1e-12)


def test_another_point_is_flown_again(callbacks):
    w = start(callbacks)
    before = callbacks.constraints(w).copy()
    w[3] -= 1e-3  # in place, as a solver may change its vector
    after = callbacks.constraints(w)
    assert callbacks.limits.evaluations == 2 and np.any(after != before)
