"""The departure state: the frozen preset, the indicative numbers of the design, SPICE, and the failures."""

from pathlib import Path

import numpy as np
import pytest
import spiceypy
from scipy.integrate import solve_ivp

from core.constants import GM_EARTH, GM_JUPITER, GM_MOON, GM_SUN
from core.ephemeris import furnish
from core.orbits.spiral import SpiralError, departure_state
from core.problem import SpiralDeparture, load_problem, problem_from
from core.world import USUAL

EXAMPLE = Path(__file__).parents[3] / "examples" / "spiral.toml"
PRESET = load_problem("ppe-drm3")


@pytest.fixture(scope="module")
def end():
    problem = load_problem(EXAMPLE)
    return departure_state(problem.departure, problem.spacecraft)


def spiral(**changes):
    return SpiralDeparture.model_validate(load_problem(EXAMPLE).departure.model_dump() | changes)


def test_the_frozen_preset_is_the_computed_end_of_the_spiral(end):
    frozen = departure_state(PRESET.departure, PRESET.spacecraft)
    assert end.et == pytest.approx(frozen.et, abs=1e-6)  # rounding of the duration in days
    # Rounding over 203 revolutions: halved steps move it by 3 m and 3e-8 km/s, so may other hardware.
    np.testing.assert_allclose(end.position_km, frozen.position_km, rtol=0, atol=0.02)
    np.testing.assert_allclose(end.velocity_km_s, frozen.velocity_km_s, rtol=0, atol=2e-7)
    assert end.mass_kg == pytest.approx(15000.0 - 15259678.0 * 3.0 / (2708.0 * 9.806), abs=1e-8)


def test_the_end_of_the_spiral_agrees_with_an_independent_indication(end):
    # Fixed-step RK4 without Jupiter: its own error is 14 km by fourth-order scaling, and 2e-4 km/s.
    difference = end.position_km - [-70193.7, -129010.0, -71570.0]
    assert np.linalg.norm(difference) < 14.0
    np.testing.assert_allclose(end.velocity_km_s, [1.55809, -0.63854, -0.30530], rtol=0, atol=2e-4)


def test_two_days_of_spiral_agree_with_spice_and_scipy():
    def rates(t, y):
        total = -GM_EARTH * y[:3] / np.linalg.norm(y[:3]) ** 3
        for body, gm in zip(USUAL["EARTH"], (GM_MOON, GM_SUN, GM_JUPITER), strict=True):
            place = spiceypy.spkpos(body, start.et + t, "J2000", "NONE", "EARTH")[0]
            away = place - y[:3]
            total += gm * (away / np.linalg.norm(away) ** 3 - place / np.linalg.norm(place) ** 3)
        total += 3e-3 / (15000.0 - 3.0 / (2708.0 * 9.806) * t) * y[3:] / np.linalg.norm(y[3:])
        return np.concatenate([y[3:], total])

    furnish()
    start = departure_state(spiral(duration_days=1e-9), PRESET.spacecraft)
    after = departure_state(spiral(duration_days=2.0), PRESET.spacecraft)
    y = np.concatenate([start.position_km, start.velocity_km_s])
    expected = solve_ivp(rates, (0.0, 2 * 86400.0), y, method="DOP853", rtol=1e-13, atol=1e-9).y[:, -1]
    # Six revolutions at tolerance 1e-13 of 34,000 km: well below a millimetre each, a start 1e-4 s late.
    np.testing.assert_allclose(after.position_km, expected[:3], rtol=0, atol=2e-3)
    np.testing.assert_allclose(after.velocity_km_s, expected[3:], rtol=0, atol=1e-6)


def test_the_parking_orbit_has_the_given_shape_and_orientation():
    start = departure_state(spiral(duration_days=1e-9), PRESET.spacecraft)
    elements = spiceypy.oscelt(np.concatenate([start.position_km, start.velocity_km_s]), start.et, GM_EARTH)
    perigee, eccentricity, *angles, anomaly = elements[:6]
    # 1e-9 d after the start; its 86 us at 10 km/s are 1e-7 rad.
    assert perigee == pytest.approx(6578.0, abs=1e-5)
    assert perigee * (1 + eccentricity) / (1 - eccentricity) == pytest.approx(33907.0, abs=1e-3)
    assert np.degrees(angles) == pytest.approx([28.446, 360.0 - 2.476, 255.0], abs=1e-5)
    assert anomaly == pytest.approx(0.0, abs=1e-6)


def test_a_spiral_may_end_at_a_jacobi_value():
    departure = spiral(duration_days=None, jacobi=12.0)
    end = departure_state(departure, PRESET.spacecraft)
    before = departure_state(spiral(duration_days=None, jacobi=12.1), PRESET.spacecraft)
    # Near the Earth C is close to 2 (1 - mu) / r - v^2 + 2 h / r^2, so it falls as the orbit grows.
    assert before.et < end.et and before.mass_kg > end.mass_kg


def test_a_spiral_that_runs_dry_is_an_error_that_names_its_goal():
    light = problem_from({"preset": "ppe-drm3", "spacecraft": {"dry_mass_kg": 14990.0}}).spacecraft
    with pytest.raises(
        SpiralError, match=r"expected 2\.0 days of thrust before .* spent, got an end at 2025-11-02"
    ):
        departure_state(spiral(duration_days=2.0), light)
    with pytest.raises(SpiralError, match=r"Jacobi constant to fall to 3\.0"):
        departure_state(spiral(duration_days=None, jacobi=3.0), light)
