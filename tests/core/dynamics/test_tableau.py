"""The coefficients satisfy the equations that define them, and agree with those of SciPy."""

import numpy as np
import pytest
from scipy.integrate import DOP853

from core.dynamics import tableau

#: Sums of 12 products up to 60: rounding of 12 * 60 * 1.1e-16.
ROUNDING = 1e-13


def test_each_stage_lies_where_its_row_of_the_matrix_says():
    np.testing.assert_allclose(tableau.A.sum(axis=1), tableau.C, atol=ROUNDING)


@pytest.mark.parametrize("q", range(8))
def test_the_weights_integrate_powers_up_to_seven_exactly(q):
    assert tableau.B @ tableau.C**q == pytest.approx(1 / (q + 1), abs=ROUNDING)


@pytest.mark.parametrize("q", range(7))
def test_the_position_weights_integrate_powers_up_to_six_twice(q):
    # The double integral of t^q from 0 to 1: order 8 in the form for second-order equations.
    assert tableau.B_POSITION @ tableau.C**q == pytest.approx(1 / ((q + 1) * (q + 2)), abs=ROUNDING)


def test_a_stage_position_is_the_place_after_constant_acceleration():
    # Every row but the second has stage order 2 or more: sum_j a_ij c_j = c_i^2 / 2.
    stages = np.delete(np.arange(tableau.N_STAGES), 1)
    expected = tableau.C[stages] ** 2 / 2
    np.testing.assert_allclose(tableau.A_POSITION.sum(axis=1)[stages], expected, atol=ROUNDING)


@pytest.mark.parametrize(("weights", "order"), [(tableau.E5, 5), (tableau.E3, 3)])
def test_an_error_estimate_of_order_p_vanishes_on_powers_below_p_and_not_on_p(weights, order):
    moments = [weights @ tableau.C**q for q in range(order + 1)]
    np.testing.assert_allclose(moments[:-1], 0.0, atol=ROUNDING)
    assert abs(moments[-1]) > 1e-6  # else it would be of a higher order, and blind to the error of this one


def test_the_method_is_the_one_that_scipy_ships():
    np.testing.assert_allclose(tableau.A, DOP853.A, rtol=1e-15)
    np.testing.assert_allclose(tableau.B, DOP853.B, rtol=1e-15)
    np.testing.assert_allclose(tableau.C, DOP853.C, rtol=1e-15)
    # SciPy has a thirteenth stage, whose weight in the errors is zero.
    np.testing.assert_allclose([*tableau.E5, 0.0], DOP853.E5, rtol=1e-15)
    np.testing.assert_allclose([*tableau.E3, 0.0], DOP853.E3, rtol=1e-15)
