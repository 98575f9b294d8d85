"""Gravity against Newton's law on a line, and its gradient against what any gravity obeys."""

import numpy as np
import pytest

from core.constants import GM_EARTH, GM_JUPITER, GM_MOON, GM_SUN
from core.dynamics import force_model
from core.dynamics.force import FIELD_WIDTH, field_at, field_table, gravity, gravity_gradient
from core.ephemeris import body_table, positions
from core.epochs import seconds_past_j2000
from core.problem import load_problem
from tests.core.partials import assert_partials

BODIES = np.array([0.8, 0.3, -0.5, -300.0, 250.0, 60.0, 1500.0, -800.0, 100.0])
GM = np.array([0.988, 0.012, 3.3e5, 314.0])


def field_of(gm, bodies):
    """Return positions, and the pulls of the bodies on the Earth."""
    apart = np.reshape(bodies, (3, 3))
    falls = gm[1:, None] * apart / np.linalg.norm(apart, axis=1, keepdims=True) ** 3
    return np.concatenate([bodies, falls.sum(axis=0)])


def pull(gm, bodies, r):
    return np.array(gravity(gm, field_of(gm, bodies), *map(float, r)))


def gradient(gm, bodies, r):
    xx, xy, xz, yy, yz, zz = gravity_gradient(gm, field_of(gm, bodies), *map(float, r))
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def test_the_earth_pulls_towards_the_origin_by_the_inverse_square():
    assert pull(np.array([2.0, 0, 0, 0]), BODIES, [0.0, 0.0, 4.0]) == pytest.approx([0, 0, -0.125], abs=1e-16)


def test_a_body_is_felt_by_the_difference_of_its_pulls_on_craft_and_earth():
    bodies = np.array([4.0, 0, 0, 0, 90.0, 0, 0, 0, 70.0])
    # The Moon, GM 8, at x = 4: on the craft at x = 2 it pulls by 8/2^2, on the Earth by 8/4^2.
    assert pull(np.array([0, 8.0, 0, 0]), bodies, [2.0, 0, 0]) == pytest.approx([2.0 - 0.5, 0, 0], abs=1e-15)


def test_two_opposite_equal_perturbers_stretch_along_their_line():
    bodies = np.array([5.0, 0, 0, -5.0, 0, 0, 0, 0, 1e9])
    found = pull(np.array([0, 3.0, 3.0, 0]), bodies, [1.0, 0, 0])
    # 3/4^2 - 3/6^2, the falls of the Earth cancelling.
    assert found == pytest.approx([3 / 16 - 3 / 36, 0, 0], abs=1e-15)


def test_jupiter_pulls_in_its_own_columns_of_the_table():
    bodies = np.array([1e9, 0, 0, 0, 1e9, 0, 0, 0, 2.0])
    assert pull(np.array([0, 0, 0, 1.0]), bodies, [0, 0, 1.0]) == pytest.approx([0, 0, 0.75], abs=1e-15)


@pytest.mark.parametrize("r", np.random.default_rng(5).uniform(-1.0, 1.0, (5, 3)))
def test_the_gradient_is_the_derivative_of_the_acceleration(r):
    # h^2 of the relative third derivatives above 0.2 LU: 1e-10 * 60 / 0.04; rounding eps / h is less.
    assert_partials(
        gradient(GM, BODIES, r), lambda x: pull(GM, BODIES, x), r, step=1e-5, rtol=1e-7, atol=1e-9
    )


def test_the_gradient_has_no_trace_as_laplace_demands():
    for r in np.random.default_rng(6).uniform(-1.0, 1.0, (20, 3)):
        found = gradient(GM, BODIES, r)
        assert np.trace(found) == pytest.approx(0.0, abs=1e-14 * np.max(np.abs(found)))  # rounding


def test_the_force_model_has_the_numbers_of_the_problem_in_canonical_units():
    problem = load_problem("ppe-drm3")
    model = force_model(problem, body_table(seconds_past_j2000(problem.departure.epoch), -1.0, 1.0))
    # LU 384,400 km and TU 375,190.25852 s, which make GM_Earth + GM_Moon 1 to 1e-8.
    factor = 375190.25852**2 / 384400.0**3
    expected = np.array([GM_EARTH, GM_MOON, GM_SUN, GM_JUPITER]) * factor
    np.testing.assert_allclose(model.gm, expected, rtol=1e-14)
    assert model.gm[0] + model.gm[1] == pytest.approx(1.0, abs=2e-8)
    # 3 N on 15,000 kg, and 2,708 s * 9.806 m/s^2, by hand.
    assert model.max_thrust == pytest.approx(0.0732402, abs=1e-7)
    assert model.max_thrust / model.exhaust_velocity == pytest.approx(2.825797e-3, abs=1e-9)


def test_the_field_has_the_bodies_and_their_pulls_on_the_earth_at_any_moment():
    bodies = body_table(seconds_past_j2000("2026-04-26T14:47:58"), -2.0, 3.0)
    table, found, place = field_table(GM, bodies), np.empty(FIELD_WIDTH), np.empty(9)
    for t in np.random.default_rng(7).uniform(-0.45, 0.68, 50):
        field_at(table.start, table.record, table.coefficients, t, found)
        positions(bodies, t, place)
        np.testing.assert_array_equal(found[:9], place)
        # The Moon's table is good to 0.2 mm, 5e-13 of its distance; its pull of 0.012 to thrice that.
        assert found[9:12] == pytest.approx(field_of(GM, place)[9:], abs=1e-13)
