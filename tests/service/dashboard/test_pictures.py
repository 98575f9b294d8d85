import json
from dataclasses import replace

import numpy as np
import pytest

from core.analysis.flight import fly
from core.problem import load_problem
from service.dashboard.pictures import flight_as_json
from tests.acceptance.known import OUTAGE, VECTORS

PROBLEM = load_problem("ppe-drm3").with_outages([(OUTAGE["segment"], OUTAGE["duration_days"])])


@pytest.fixture(scope="module")
def flight():
    return fly(PROBLEM, np.array(VECTORS["S(1|0)"][0]))


def test_a_flight_keeps_its_numbers_to_what_a_picture_shows(flight):
    sent = json.loads(json.dumps(flight_as_json(flight), allow_nan=False))
    realization, flown = sent["trajectories"][1], flight.trajectories[1]
    assert realization["outage"] == OUTAGE and realization["arcs"][0]["kind"] == "outage"
    assert np.array(realization["inertial_km"]) == pytest.approx(flown.inertial_km, abs=0.5)
    assert np.array(realization["mass_kg"]) == pytest.approx(flown.mass_kg, abs=5e-4)
    assert sent["trajectories"][0]["outage"] is None


def test_a_picture_of_one_outage_is_a_few_thousand_points(flight):
    sent = flight_as_json(flight)
    points = sum(len(trajectory["days"]) for trajectory in sent["trajectories"]) + len(sent["target"]["days"])
    assert points < 5000
    assert len(json.dumps(sent)) < 350_000


def test_what_is_not_finite_is_null(flight):
    spoiled = np.where(np.arange(len(flight.moon.days)) == 1, np.nan, flight.moon.days)
    sent = flight_as_json(replace(flight, moon=flight.moon._replace(days=spoiled)))
    assert sent["moon"]["days"][1] is None
    json.dumps(sent, allow_nan=False)


def test_a_long_flight_is_thinned_arc_by_arc_and_says_so(flight):
    sent = flight_as_json(flight, most=600)
    whole = flight_as_json(flight)
    assert sum(len(trajectory["days"]) for trajectory in sent["trajectories"]) < 900 < sent["n_samples"]
    for thin, full in zip(sent["trajectories"], whole["trajectories"], strict=True):
        ends = [(thin["days"][arc["first"]], thin["days"][arc["stop"] - 1]) for arc in thin["arcs"]]
        assert ends == [(full["days"][arc["first"]], full["days"][arc["stop"] - 1]) for arc in full["arcs"]]
        assert thin["days"][thin["matchpoint"]] == full["days"][full["matchpoint"]]


def test_without_its_frames_a_flight_takes_half_the_room(flight):
    sent = flight_as_json(flight, has_frames=False)
    assert all("rotating_km" not in track for track in (*sent["trajectories"], sent["moon"], sent["target"]))
    assert len(json.dumps(sent)) < 0.6 * len(json.dumps(flight_as_json(flight)))
