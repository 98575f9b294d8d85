"""Paths through Earth or Moon: refused where they lead inside, wherever they are closed."""

from functools import cache

import numpy as np
import pytest

from core.constants import GM_MOON
from core.dynamics import STATE, propagate
from core.dynamics.dop853 import BELOW_SURFACE
from core.ephemeris import states
from core.problem import problem_from
from core.transcription import Transcription, fly_arc
from tests.core.known import optimum, solution
from tests.core.transcription.points import UNITS, random_point, transcription

COAST, DAY = np.zeros(3), 86400.0 / 375190.25852
MOON_KM, PASSAGE_DAYS = 1737.4, 3.0


def moon(flown, t):
    """Return the Moon's position and velocity [LU, VU] at t."""
    table = flown.setting.model.bodies
    both = np.empty((3, table.coefficients.shape[2]))
    states(table, t, both)
    return both[:2, :3]


@cache
def passing(distance_km):
    """Return a transcription, and a vector that coasts past the Moon at a distance from its centre."""
    flown, t = transcription(), PASSAGE_DAYS * DAY
    place, velocity = moon(flown, t)
    away = np.cross(place, velocity)
    away *= distance_km / UNITS[0] / np.linalg.norm(away)
    # Fast enough to leave, at a right angle to the line from the Moon, so that this is the closest approach.
    velocity = velocity + place / np.linalg.norm(place) * np.sqrt(4.0 * GM_MOON / distance_km) / UNITS[3]
    start = fly_arc(flown, np.concatenate([place + away, velocity, [0.9]]), t, 0.0) * UNITS
    departure = {"position_km": start[:3].tolist(), "velocity_km_s": start[3:6].tolist()}
    flown = Transcription(problem_from({"preset": "ppe-drm3", "departure": departure}))
    x = random_point(flown, 1)
    x[1] = 2.0 * PASSAGE_DAYS
    return flown, x


@pytest.mark.parametrize(
    ("distance_km", "is_clear"),
    # A certificate marks passages below 100 km, so the solver makes none.
    [(900.0, False), (1600.0, False), (1830.0, False), (1900.0, True), (5000.0, True)],
)
def test_a_path_is_clear_if_it_leads_past_the_moon_and_not_into_it(distance_km, is_clear):
    flown, x = passing(distance_km)
    assert np.isfinite(flown.defects(x)).all()  # flown through, a point of mass being all that pulls
    assert flown.is_clear(x) is is_clear


def test_the_same_departure_is_clear_if_the_coast_ends_before_the_moon():
    flown, x = passing(900.0)
    x = x.copy()
    x[0], x[1] = 1.0, 0.5
    assert flown.is_clear(x)


def test_a_path_that_starts_below_the_surface_of_the_earth_is_not_clear():
    at = {"position_km": [6000.0, 0.0, 0.0], "velocity_km_s": [0.0, 20.0, 0.0]}
    flown = Transcription(problem_from({"preset": "ppe-drm3", "departure": at}))
    assert not flown.is_clear(random_point(flown, 1))


@pytest.mark.parametrize("x", [solution(), optimum()])
def test_known_solutions_are_clear_and_looking_changes_nothing(x):
    flown = transcription(n_legs=10, tolerance=3e-10)
    before = flown.defects(x)
    assert flown.is_clear(x) and not flown.setting.model.surfaces.any()
    np.testing.assert_array_equal(flown.defects(x), before)


def flight(flown, radius_km, days):
    """Return the result of a coast from departure for so many days, the Moon having a radius."""
    surfaces = np.array([0.0, radius_km / UNITS[0]])
    model, departure = flown.setting.model._replace(surfaces=surfaces), flown.setting.departure
    r, v = departure[:3].reshape(3, 1).copy(), departure[3:6].reshape(3, 1).copy()
    work = np.zeros((16, 3, STATE))
    rest = COAST, 0.0, np.zeros((3, 3)), COAST, 1e-12, r, v, np.zeros((2, 3)), work
    return propagate(model, 0.0, days * DAY, departure[6], *rest)


def test_an_integration_ends_with_the_status_of_the_surface_that_it_sinks_below():
    flown, _ = passing(900.0)
    assert flight(flown, MOON_KM, 2.0 * PASSAGE_DAYS) == BELOW_SURFACE
    assert flight(flown, MOON_KM, 0.9 * PASSAGE_DAYS) > 0
    assert flight(flown, 0.0, 2.0 * PASSAGE_DAYS) > 0  # no surface lets all pass
    assert flight(flown, 850.0, 2.0 * PASSAGE_DAYS) > 0
