import numpy as np
import pytest

from core.ephemeris.kernels import furnish
from core.epochs import seconds_past_j2000
from core.verification import repropagation
from core.verification.repropagation import Pilot, UnflyableError
from core.world import BODIES

EARTH_GM = 398600.43550702266
ORIGIN_ET = seconds_past_j2000("2026-04-26T14:47:58")


@pytest.fixture
def pilot():
    furnish()
    return Pilot(ORIGIN_ET, max_thrust_n=3.0, exhaust_velocity_km_s=26.554648)


def state_of(position, velocity, mass=1000.0):
    return np.array([*position, *velocity, mass], dtype=float)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_circular_orbit_without_perturbers_returns_after_its_period(pilot, direction):
    pilot.bodies = ()
    radius = 42164.0
    start = state_of((radius, 0, 0), (0, np.sqrt(EARTH_GM / radius), 0))
    period = 2 * np.pi * np.sqrt(radius**3 / EARTH_GM)
    end = pilot.arc(0.0, start, direction * period)
    # 50 steps of 1e-12 of 42,000 km, magnified along the track by 3 pi; at 7.3e-5 rad/s.
    assert end[:3] == pytest.approx(start[:3], abs=2e-5)
    assert end[3:6] == pytest.approx(start[3:6], abs=2e-9)


def test_the_moons_tide_on_the_line_of_centres_is_the_difference_of_two_inverse_squares(pilot):
    pilot.bodies, pilot.center = pilot.bodies[:1], pilot.center._replace(gm_km3_s2=0.0)
    moon = pilot.target_state(BODIES["MOON"].naif_id, 0.0)[:3]
    distance, near = np.linalg.norm(moon), 3.0e5
    end = pilot.arc(0.0, state_of(near * moon / distance, (0, 0, 0)), 600.0)
    tide = 4902.8001184575496 * (1 / (distance - near) ** 2 - 1 / distance**2)
    # The Moon moves 600 km in ten minutes: 1 % of its distance from the craft.
    assert np.dot(end[3:6], moon) / distance == pytest.approx(tide * 600.0, rel=1e-2)


def test_thrust_without_gravity_follows_the_rocket_equation(pilot):
    pilot.bodies, pilot.center = (), pilot.center._replace(gm_km3_s2=0.0)
    start, duration = state_of((1e5, 0, 0), (0, 0, 0)), 20 * 86400.0
    end = pilot.arc(0.0, start, duration, pilot.thrust(np.array([0.5, np.pi / 2, 0.0])))
    burned = 0.5 * 3.0e-3 / 26.554648 * duration
    assert end[6] == pytest.approx(1000.0 - burned, rel=1e-14)  # closed form, rounding
    assert end[4] == pytest.approx(26.554648 * np.log(1000.0 / (1000.0 - burned)), rel=1e-11)  # RTOL a step
    assert end[[0, 2, 3, 5]] == pytest.approx([1e5, 0, 0, 0], abs=1e-9)


def test_an_arc_flown_back_returns_to_its_start(pilot):
    start = state_of((-70193.7, -129010.0, -71570.0), (1.55809, -0.63854, -0.3053), 13276.0)
    thrust = pilot.thrust(np.array([0.8, 1.0, -0.4]))
    end = pilot.arc(0.0, start, 10 * 86400.0, thrust)
    back = pilot.arc(10 * 86400.0, end, -10 * 86400.0, thrust)
    assert back[:3] == pytest.approx(start[:3], abs=1e-4)  # two revolutions amplify 1e-12 steps
    assert back[6] == pytest.approx(start[6], abs=1e-9)


def test_a_fall_into_the_moon_is_told_with_its_epoch(pilot):
    moon = pilot.target_state(BODIES["MOON"].naif_id, 0.0)
    above = state_of(moon[:3] + np.array([20000.0, 0, 0]), moon[3:])
    with pytest.raises(UnflyableError, match=r"meets the Moon 0\.\d+ days after departure"):
        pilot.arc(0.0, above, 3 * 86400.0)


def test_an_arc_that_burns_more_than_its_mass_is_refused(pilot):
    start = state_of((1e5, 0, 0), (0, 2.0, 0), mass=10.0)
    with pytest.raises(UnflyableError, match="no mass left"):
        pilot.arc(0.0, start, 5 * 86400.0, pilot.thrust(np.array([1.0, 0, 0])))


def test_an_endless_spiral_is_given_up(pilot, monkeypatch):
    monkeypatch.setattr(repropagation, "MAX_EVALUATIONS", 500)
    start = state_of((7000.0, 0, 0), (0, np.sqrt(EARTH_GM / 7000.0), 0))
    with pytest.raises(UnflyableError, match="integration gave up"):
        pilot.arc(0.0, start, 30 * 86400.0)
