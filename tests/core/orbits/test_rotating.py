"""The instantaneous frame: the Moon rests in it, and a circular Moon makes it that of the CR3BP."""

import numpy as np
import pytest

from core.constants import MU_CR3BP
from core.ephemeris import body_table, state_at
from core.epochs import seconds_past_j2000
from core.orbits.nrho import halo_of_period
from core.orbits.rotating import jacobi, rotating_frame, to_inertial
from core.units import TU_DAYS
from tests.core.orbits.jacobi import jacobi_constant

#: A Moon on a circle of 1 LU with the mean motion 1/TU.
CIRCULAR = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [-0.6, -0.8, 0.0]])
EARTH_IN_FRAME = np.array([-MU_CR3BP, 0.0, 0.0])


@pytest.fixture(scope="module")
def bodies():
    return body_table(seconds_past_j2000("2026-04-26T14:47:58"), 0.0, 30.0)


def test_the_moon_rests_in_the_frame(bodies):
    for days in (0.0, 7.7, 21.3):
        moon = state_at(bodies, days)[:, :3]
        position, velocity = to_inertial(rotating_frame(moon), np.array([1.0, 0.0, 0.0]), np.zeros(3))
        np.testing.assert_allclose(position, moon[0], atol=1e-15)  # rounding
        np.testing.assert_allclose(velocity, moon[1], atol=1e-15)  # rounding


def test_velocities_are_derivatives_of_positions_of_a_point_at_rest(bodies):
    h, place = 1e-4, np.array([0.3, -0.2, 0.5])
    for days in (0.0, 7.7, 21.3):
        frames = [rotating_frame(state_at(bodies, days + step * TU_DAYS)[:, :3]) for step in (0.0, h, 2 * h)]
        before, now, after = (to_inertial(frame, place, np.zeros(3)) for frame in frames)
        # h^2/6 times a third derivative below 10; rounding 1e-16 / h.
        np.testing.assert_allclose((after[0] - before[0]) / (2 * h), now[1], atol=3e-8)


def test_jacobi_of_a_circular_moon_is_that_of_the_cr3bp():
    frame = rotating_frame(CIRCULAR)
    for state in halo_of_period(1.5111964).states(np.array([0.0, 0.2, 0.5, 0.7])):
        position, velocity = to_inertial(frame, state[:3] - EARTH_IN_FRAME, state[3:])
        # Rounding, near perilune that of 2 mu / r2 = 3 and v^2 = 3.
        assert jacobi(CIRCULAR, position, velocity) == pytest.approx(jacobi_constant(state), abs=1e-13)


def test_jacobi_of_a_circular_orbit_at_25_earth_radii_is_that_of_the_design():
    radius = 25.5 * 6378.137 / 384400.0
    position = np.array([0.0, -radius, 0.0])
    velocity = np.array([np.sqrt((1.0 - MU_CR3BP) / radius), 0.0, 0.0])
    # The design says 3.65, about the Earth; the barycentre is 0.012 off, which turns up as 2 * 0.012 * 1.5.
    assert jacobi(CIRCULAR, position, velocity) == pytest.approx(3.65, abs=0.04)
