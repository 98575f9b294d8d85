"""Halo orbits against the table of the design, which another program computed."""

import numpy as np
import pytest

from core.constants import MU_CR3BP
from core.orbits.nrho import HaloError, halo_of_period
from core.units import LU_KM
from tests.core.orbits.jacobi import jacobi_constant

# Period, x, z and vy at apolune, Jacobi constant, perilune and apolune radius [km].
ROWS = [
    (1.5111964, 1.0220279848, -0.1821012438, -0.1032704533, 3.046494, 3249, 71222),
    (1.5091498, 1.0218727062, -0.1819940303, -0.1029319761, 3.046649, 3225, 71171),
    (1.4804450, 1.0196977779, -0.1804450148, -0.0981382187, 3.048872, 2896, 70435),
]


@pytest.mark.parametrize("row", ROWS)
def test_halo_reaches_the_printed_digits(row):
    period, x, z, vy, constant, perilune, apolune = row
    orbit = halo_of_period(period)
    # Half a unit of the last printed digit of the table, and the period is printed to 5e-8: dx/dT = 0.076.
    np.testing.assert_allclose(orbit.apolune[[0, 2, 4]], [x, z, vy], rtol=0, atol=1.0e-8)
    assert jacobi_constant(orbit.apolune) == pytest.approx(constant, abs=5.1e-7)
    ends = orbit.states(np.array([0.0, 0.5 * period]))[:, :3] - [1.0 - MU_CR3BP, 0.0, 0.0]
    assert np.linalg.norm(ends, axis=1) * LU_KM == pytest.approx([apolune, perilune], abs=0.51)


def test_halo_returns_after_its_period_and_keeps_its_jacobi_constant():
    orbit = halo_of_period(1.6)
    end = orbit.states(np.array([1.6]))[0]
    # The residual 5e-13 grows by the largest entry of the monodromy matrix, some hundreds.
    np.testing.assert_allclose(end, orbit.apolune, rtol=0, atol=1e-10)
    assert jacobi_constant(end) == pytest.approx(jacobi_constant(orbit.apolune), abs=1e-11)


def test_a_period_outside_the_family_is_an_error_that_names_it():
    with pytest.raises(HaloError, match=r"expected a symmetric orbit of period .* TU, got a residual"):
        halo_of_period(0.2)
