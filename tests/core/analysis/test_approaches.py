import numpy as np
import pytest
import spiceypy

from core.ephemeris.kernels import furnish
from core.epochs import seconds_past_j2000
from core.orbits import target_kernel
from core.problem import load_problem
from core.verification.closest_approach import Closest
from core.verification.repropagation import Pilot
from tests.core.analysis.by_hand import GM

ORIGIN_ET = seconds_past_j2000("2026-04-26T14:47:58")
DAY = 86400.0


def watched_pilot():
    furnish()
    pilot = Pilot(ORIGIN_ET, max_thrust_n=3.0, exhaust_velocity_km_s=26.554648)
    pilot.watcher = Closest(pilot)
    return pilot


def by_body(pilot):
    return {approach.body: approach for approach in pilot.watcher.approaches}


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_perigee_of_an_ellipse_is_where_kepler_has_it(direction):
    pilot, (perigee, apogee) = watched_pilot(), (7000.0, 380000.0)
    pilot.bodies = ()
    a = (perigee + apogee) / 2
    speed = np.sqrt(GM[399] * (2 / apogee - 1 / a))
    half_period = np.pi * np.sqrt(a**3 / GM[399])
    start = np.array([apogee, 0, 0, 0, direction * speed, 0, 1000.0])
    pilot.arc(0.0, start, direction * 1.5 * half_period)
    earth = by_body(pilot)["Earth"]
    assert earth.is_turn and earth.distance_km == pytest.approx(perigee, abs=1e-5)  # interpolant of order 7
    # The distance is flat there: 1e-5 km of it are (2e-5 / 13 km) ** 0.5 * 900 s.
    assert earth.days * DAY == pytest.approx(direction * half_period, abs=0.1)
    assert earth.altitude_km == earth.distance_km - 6378.137


def test_the_perilune_of_the_nrho_is_the_one_that_spice_finds():
    pilot, (kernel, naif_id) = watched_pilot(), target_kernel(load_problem("ppe-drm3"))
    furnish(kernel)
    window = spiceypy.stypes.SPICEDOUBLE_CELL(2)
    spiceypy.wninsd(ORIGIN_ET + 5 * DAY, ORIGIN_ET + 11 * DAY, window)
    found = spiceypy.stypes.SPICEDOUBLE_CELL(20)
    spiceypy.gfdist(str(naif_id), "NONE", "MOON", "LOCMIN", 0.0, 0.0, DAY / 4, 100, window, found)
    perilune_et = spiceypy.wnfetd(found, 0)[0]
    state, _ = spiceypy.spkgeo(naif_id, perilune_et, "J2000", 301)
    pilot.arc(5 * DAY, np.append(pilot.target_state(naif_id, 5 * DAY), 1000.0), 6 * DAY)
    moon = by_body(pilot)["Moon"]
    assert spiceypy.wncard(found) == 1 and moon.is_turn
    # The kernel is a fit to 1e-4 km of a ballistic orbit, on which a perilune doubles errors several times.
    assert moon.distance_km == pytest.approx(np.linalg.norm(state[:3]), abs=0.02)
    assert moon.et == pytest.approx(perilune_et, abs=0.5)


def test_a_flight_that_only_departs_is_closest_where_it_begins():
    pilot = watched_pilot()
    pilot.arc(0.0, np.array([50000.0, 0, 0, 8.0, 0, 0, 1000.0]), 0.5 * DAY)
    earth = by_body(pilot)["Earth"]
    assert not earth.is_turn and earth.days == 0.0 and earth.distance_km == pytest.approx(50000.0, abs=1e-6)
