import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from core.verification import verify as judge
from core.verification.certificate import _low_passages as too_low
from core.verification.certificate import certify, lowest_passages
from core.verification.closest_approach import Approach
from core.verification.verify import verify
from tests.core.analysis.by_hand import (
    EARLY,
    ORIGIN_ET,
    SEGMENTS,
    START,
    Arc,
    fly,
    known_transfer,
    problem_with,
    rates,
)

DAY = 86400.0


@pytest.fixture(autouse=True)
def any_coverage(monkeypatch):
    """Take targets that cover the arrivals alone, as in the tests of the verifier."""
    monkeypatch.setattr(judge, "target_kernel", lambda problem: (problem.target.path, problem.target.naif_id))


@pytest.fixture(scope="module")
def transfer(tmp_path_factory):
    return known_transfer(tmp_path_factory.mktemp("spk") / "by_hand.bsp")


@pytest.fixture(scope="module")
def certified(transfer):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(judge, "target_kernel", lambda problem: (problem.target.path, problem.target.naif_id))
        return certify(*transfer)


def test_a_transfer_flown_by_hand_arrives_on_the_target_with_no_matchpoint(certified):
    for flown in certified.trajectories:
        # LSODA's global error over 12 days rules, as in the defects.
        assert flown.through.insertion_miss == pytest.approx((0, 0), abs=2e-2)
        assert flown.through.arrival_miss[1] < 1e-6 and abs(flown.through.mass_miss_kg) < 1e-6
        assert flown.through.failure == ""


def test_halves_that_are_watched_have_the_same_defects_bit_for_bit(transfer, certified):
    watched, alone = certified.verification, verify(*transfer)
    assert np.array_equal(watched.defects, alone.defects) and watched.kernels == alone.kernels


def test_an_error_in_the_last_burn_is_missed_by_as_much_as_another_integrator_says(transfer):
    problem, x = transfer
    changed = x.copy()
    changed[3 + 3 * 5] = 0.7  # the throttle of segment 6, by hand 0.8
    states, _ = fly(0.0, START, [Arc(2.0), *SEGMENTS[:5], SEGMENTS[5]._replace(throttle=0.7), Arc(0.5)])
    right, _ = fly(0.0, START, [Arc(2.0), *SEGMENTS, Arc(0.5)])
    flown = certify(problem, changed).trajectories
    through = flown[0].through
    missed = np.linalg.norm(states[-1][:3] - right[-1][:3])
    assert missed > 100.0 and through.arrival_miss[0] == pytest.approx(missed, abs=2e-2)
    assert through.mass_miss_kg == pytest.approx(states[-1][6] - right[-1][6], abs=1e-6)
    # An outage is flown before it, so the recoveries do not change.
    assert flown[1].through.arrival_miss[0] < 2e-2


def test_a_realization_departs_from_the_reference_as_flown_not_as_planned(transfer):
    problem, x = transfer
    changed = x.copy()
    changed[3] = 0.5  # the throttle of segment 1, before both outages
    found = certify(problem, changed)
    states, epochs = fly(0.0, START, [Arc(2.0), SEGMENTS[0]._replace(throttle=0.5)])
    early, _ = fly(epochs[-1], states[-1], [Arc(0.5), Arc(0.25), *EARLY, Arc(0.25)])
    right, _ = fly(0.0, START, [Arc(2.0), SEGMENTS[0], Arc(0.5), Arc(0.25), *EARLY, Arc(0.25)])
    missed = np.linalg.norm(early[-1][:3] - right[-1][:3])
    assert found.trajectories[1].through.arrival_miss[0] == pytest.approx(missed, rel=1e-6, abs=2e-2)
    # As planned the late one begins at the backward state, which that throttle does not move.
    assert found.verification.position_km[2] < 1e-2 < found.trajectories[2].through.arrival_miss[0]


def turns_of(arcs):
    """Return (distance, days) of each perigee, by the event finder of another integrator."""
    states, epochs = fly(0.0, START, arcs)
    found = []
    for arc, days, state in zip(arcs, epochs, states, strict=False):
        span = (days * DAY, (days + arc.days) * DAY)
        flown = solve_ivp(rates, span, state, "LSODA", args=(arc,), events=outwards, rtol=1e-12, atol=1e-10)
        turned = zip(flown.y_events[0], flown.t_events[0], strict=True)
        found += [(float(np.linalg.norm(y[:3])), t / DAY) for y, t in turned]
    return found


def outwards(t, y, arc):
    return y[:3] @ y[3:6]


outwards.direction = 1.0


def test_the_closest_approach_is_the_lowest_perigee_that_another_integrator_finds(certified):
    earth, _ = certified.trajectories[0].closest_through
    distance, days = min(turns_of([Arc(2.0), *SEGMENTS, Arc(0.5)]))
    assert earth.is_turn and earth.distance_km == pytest.approx(distance, abs=2e-2)  # LSODA's error
    assert earth.days == pytest.approx(days, abs=1e-5)
    assert earth.et == pytest.approx(ORIGIN_ET + earth.days * DAY, abs=1e-6)


def test_the_masses_are_those_of_the_rocket_equation(certified):
    reference, early, _ = (flown.mass for flown in certified.trajectories)
    flow = 3.0 / (2708.0 * 9.806) * DAY
    assert reference.segments == pytest.approx(
        flow * sum(arc.days * arc.throttle for arc in SEGMENTS), rel=1e-12
    )
    assert early.before_outage == pytest.approx(flow * 1.5 * 0.9, rel=1e-12)
    assert early.segments == pytest.approx(flow * sum(arc.days * arc.throttle for arc in EARLY), rel=1e-12)
    assert early.arrival == pytest.approx(early.stated_arrival, abs=1e-6)
    assert reference.wet == reference.spiral + reference.departure == 15000.0
    assert reference.spare == reference.arrival - 5000.0


def test_a_passage_below_the_set_altitude_is_marked_and_unsound(transfer, certified):
    free = certified
    lowest = min(flown.closest[0].altitude_km for flown in free.trajectories)
    assert free.is_sound and free.level == "strict" and not free.marks
    low = certify(*transfer, min_altitude_km=lowest + 1.0)
    assert not low.is_sound and low.level == "strict"
    assert {mark.approach.altitude_km for mark in low.marks} >= {lowest}


def test_passages_are_marked_below_200_km_over_the_earth_and_100_km_over_the_moon(certified):
    assert dict(certified.min_altitudes_km) == {"Earth": 200.0, "Moon": 100.0}
    low = [Approach(body, 0.0, 150.0, 0.0, 0.0, True) for body in ("Earth", "Moon")]
    flown = dataclasses.replace(certified.trajectories[0], closest=tuple(low))
    assert [mark.approach.body for mark in too_low((flown,), lowest_passages())] == ["Earth"]
    assert len(too_low((flown,), lowest_passages(151.0))) == 2


@pytest.mark.parametrize("altitude_km", [-1.0, float("nan"), float("inf")])
def test_a_lowest_passage_that_is_none_is_refused(transfer, altitude_km):
    with pytest.raises(ValueError, match=f"min_altitude_km: expected .* at least 0, .*, got {altitude_km}"):
        certify(*transfer, min_altitude_km=altitude_km)


def test_a_solution_below_its_dry_mass_is_not_sound_and_says_which_trajectory(transfer):
    problem, x = transfer
    dry_mass_kg = float(x[37]) + 0.5
    craft = problem.spacecraft.model_copy(update={"dry_mass_kg": dry_mass_kg})
    found = certify(problem.model_copy(update={"spacecraft": craft}), x)
    assert found.level == "none" and not found.is_sound and not found.marks
    light = [index for index, mass in enumerate(x[[21, 37, 44]]) if mass < dry_mass_kg]
    assert 1 in light and [lack.trajectory for lack in found.lacks] == light
    assert found.lacks[0].least_kg == dry_mass_kg


def test_a_flight_into_the_earth_is_no_solution_and_says_where(transfer):
    problem, x = transfer
    departure = problem.departure.model_dump() | {"velocity_km_s": [0.0, 0.0, 0.0]}
    found = certify(problem_with(problem.target.path, 6, [(2, 0.5), (5, 0.5)], departure=departure), x)
    assert found.level == "none" and not found.is_sound
    assert found.trajectories[0].through.failure.startswith("meets the Earth")
    assert "could not be flown" in found.trajectories[1].through.failure
