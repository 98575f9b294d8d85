"""The multiple shooting: its partials, its joints under another integrator, and how it fails."""

import numpy as np
import pytest
import scipy
from scipy.integrate import solve_ivp

from core.constants import SECONDS_PER_DAY
from core.dynamics import force_model
from core.ephemeris import body_table, state_at
from core.epochs import seconds_past_j2000
from core.orbits import nrho as shooting
from core.orbits.nrho import margin_days, nrho
from core.problem import load_problem
from core.units import LU_KM, TU_DAYS, VU_KM_S

PERIOD = 6.5623
WINDOW = (0.0, 20.0)
PROBLEM = load_problem("ppe-drm3")
ORIGIN = seconds_past_j2000(PROBLEM.departure.epoch)
PERILUNE = (seconds_past_j2000("2026-04-30T00:00:00") - ORIGIN) / SECONDS_PER_DAY


@pytest.fixture(scope="module")
def model():
    margin = margin_days(PERIOD)
    return force_model(PROBLEM, body_table(ORIGIN, WINDOW[0] - margin, WINDOW[1] + margin))


@pytest.fixture(scope="module")
def orbit(model):
    return nrho(model, PERIOD, PERILUNE, WINDOW)


def defects(model, epochs, states):
    halves = shooting.fly_halves(model, epochs, states)
    return halves[:, 0, :, 0] - halves[:, 1, :, 0]


def fly_by_scipy(model, epoch, state, stop):
    def rates(t, y):
        bodies = state_at(model.bodies, t * TU_DAYS)[0].reshape(3, 3)
        total = -model.gm[0] * y[:3] / np.linalg.norm(y[:3]) ** 3
        for gm, body in zip(model.gm[1:], bodies, strict=True):
            away = body - y[:3]
            total += gm * (away / np.linalg.norm(away) ** 3 - body / np.linalg.norm(body) ** 3)
        return np.concatenate([y[3:], total])

    return solve_ivp(rates, (epoch, stop), state, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]


def test_node_defects_are_below_a_millimetre(model, orbit):
    joints = defects(model, orbit.epochs, orbit.states)
    assert np.linalg.norm(joints[:, :3], axis=1).max() * LU_KM < 1e-6
    assert np.linalg.norm(joints[:, 3:], axis=1).max() * VU_KM_S < 1e-9


def test_pieces_join_under_another_integrator(model, orbit):
    for piece in range(8, 16):
        middle = 0.5 * (orbit.epochs[piece] + orbit.epochs[piece + 1])
        first, second = (
            fly_by_scipy(model, orbit.epochs[n], orbit.states[n], middle) for n in (piece, piece + 1)
        )
        # Both integrators err by 1e-13 LU a step, and a perilune magnifies that three hundred times.
        assert np.linalg.norm(first[:3] - second[:3]) * LU_KM < 1e-4
        assert np.linalg.norm(first[3:] - second[3:]) * VU_KM_S < 1e-9


def test_partials_of_the_defects_equal_central_differences(model, orbit):
    epochs, states = orbit.epochs[:6], orbit.states[:6] + 1e-4  # off the solution
    jacobian = shooting._jacobian(shooting.fly_halves(model, epochs, states)).toarray()
    unknowns, h = np.column_stack([epochs, states]), 1e-8
    for column in range(unknowns.size):
        step = np.zeros(unknowns.size)
        step[column] = h
        sides = [unknowns + sign * step.reshape(-1, 7) for sign in (-1.0, 1.0)]
        before, after = (defects(model, side[:, 0], side[:, 1:]).ravel() for side in sides)
        # Rounding, magnified 300 times at perilune: 1e-13 / h = 1e-5; h^2 times third derivatives of 1e8.
        difference = (after - before) / (2 * h)
        np.testing.assert_allclose(jacobian[:, column], difference, rtol=1e-5, atol=2e-4)


def test_the_step_is_the_least_that_solves():
    rng = np.random.default_rng(3)
    jacobian, goal = rng.normal(size=(6, 14)), rng.normal(size=6)
    expected = np.linalg.lstsq(jacobian, goal)[0]
    actual = shooting._smallest_step(scipy.sparse.csc_array(jacobian), goal)
    np.testing.assert_allclose(actual, expected, atol=1e-13)  # rounding, condition below 10


def test_the_orbit_between_patch_points_is_the_flown_one(model, orbit):
    times = np.array([[0.9, 1.0], [1.6, 1.7]])
    n = np.searchsorted(orbit.epochs, 1.0) - 1
    expected = fly_by_scipy(model, orbit.epochs[n], orbit.states[n], 1.0)
    moon = state_at(model.bodies, TU_DAYS)[:2, :3].ravel()
    actual = orbit.states_from_moon(times)[0, 1]
    # As for the joints, of a whole piece: a millimetre at each end, magnified.
    np.testing.assert_allclose(actual, expected - moon, rtol=0, atol=1e-9)


def test_a_guess_at_the_centre_of_the_earth_is_an_error(model, orbit):
    with pytest.raises(shooting.ShootingError, match=r"expected defects below 1e-06 km, got nan km"):
        shooting.correct(model, orbit.epochs[:6], np.zeros((6, 6)))
