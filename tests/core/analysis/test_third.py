import json
from pathlib import Path

import numpy as np
import pytest

from core.constants import GM_EARTH
from core.problem import load_problem
from core.verification.certificate import certify
from core.verification.end_to_end import apart
from core.verification.heyoka_check import links_of, read_runs
from core.verification.repropagation import UnflyableError, pilot_of
from core.world import EARTH
from tests.core.analysis.by_hand import ORIGIN_ET

pytest.importorskip("heyoka", reason="heyoka is an extra: pip install -c constraints.txt -e '.[heyoka]'")
from core.verification.heyoka_check import INTEGRATOR, TOLERANCE, TaylorPilot

DAY = 86400.0
VECTORS = json.loads((Path(__file__).parents[2] / "acceptance" / "vectors.json").read_text(encoding="utf-8"))
PRESET = load_problem("ppe-drm3")
ROBUST = PRESET.with_outages([(24, 1.0)])


@pytest.fixture(scope="module")
def scipy_pilot():
    return pilot_of(PRESET)


@pytest.fixture(scope="module")
def pilot(scipy_pilot):
    return TaylorPilot(scipy_pilot, read_runs(links_of(EARTH), ORIGIN_ET, ORIGIN_ET + 50 * DAY), EARTH)


@pytest.fixture(scope="module")
def certified():
    return certify(ROBUST, np.array(VECTORS["S(1|0)"][0]), with_heyoka=True)


def test_real_trajectories_flown_by_two_integrators_from_two_readings_of_the_ephemeris_agree(certified):
    third = certified.third
    assert (third.integrator, third.tolerance) == (INTEGRATOR, TOLERANCE)
    for ours, flown in zip(third.flights, certified.trajectories, strict=True):
        position, velocity = apart(ours, flown.through)
        # SciPy's 1e-13 a step, grown some 1e5 times by 80 days of thrust and a passage of the Moon: metres.
        assert position < 0.05 and velocity < 5e-6 and ours.failure == ""
        # The final coast, with a perilune in it, makes tens of metres of that.
        assert ours.arrival_miss[0] == pytest.approx(flown.through.arrival_miss[0], abs=0.3)
        assert ours.mass_miss_kg == flown.through.mass_miss_kg


def test_an_arc_across_records_under_thrust_ends_where_scipy_ends(pilot, scipy_pilot):
    state = np.array([1e5, -5e4, 2e4, 0.9, 1.4, 0.3, 13000.0])
    thrust = pilot.thrust(np.array([0.8, 0.3, -0.2]))
    ours, theirs = (one.arc(1234.5, state, 20 * DAY, thrust) for one in (pilot, scipy_pilot))
    # SciPy's 1e-13 per step, of some hundred steps about a body that amplifies errors linearly in time.
    assert ours[:3] == pytest.approx(theirs[:3], abs=1e-3) and ours[3:6] == pytest.approx(
        theirs[3:6], abs=1e-8
    )
    assert ours[6] == theirs[6]


def test_near_the_earth_it_flies_keplers_ellipse(pilot):
    radius, turn = 7000.0, 2 * np.pi * np.sqrt(7000.0**3 / GM_EARTH)
    speed = np.sqrt(GM_EARTH / radius)
    end = pilot.arc(0.0, np.array([radius, 0, 0, 0, speed, 0, 1000.0]), turn)
    # The Moon's tide, 2 GM r / d^3 = 1e-9 km/s^2, over a turn of 5800 s: some 0.1 km.
    assert end[:3] == pytest.approx([radius, 0, 0], abs=0.3)


def test_an_arc_in_two_parts_is_the_same_arc(pilot):
    state = np.array([1e5, -5e4, 2e4, 0.9, 1.4, 0.3, 13000.0])
    thrust = pilot.thrust(np.array([1.0, 0.0, 0.0]))
    whole = pilot.arc(0.0, state, 9.7 * DAY, thrust)
    parts = pilot.arc(3.1 * DAY, pilot.arc(0.0, state, 3.1 * DAY, thrust), 6.6 * DAY, thrust)
    # The last bit of 1e5 km is 1e-11; some dozens of steps.
    assert whole == pytest.approx(parts, rel=1e-12, abs=1e-6)


def test_a_fall_into_the_centre_is_given_up(pilot):
    with pytest.raises(UnflyableError, match="integration gave up"):
        pilot.arc(0.0, np.array([7000.0, 0, 0, 0, 0, 0, 1000.0]), DAY)
