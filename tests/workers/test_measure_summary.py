import numpy as np
import pytest

from workers.measure_solves import NOT_VERIFIED, Measurement, costs, failures, share, spread, summary

STRICT = Measurement("OPTIMAL", True, True, True, 165.0, 2e-7, 300, 900, 4.0, 0.3)
NEARLY = Measurement("ACCEPTABLE", True, True, True, 175.0, 3e-6, 500, 1500, 6.0, 0.3)
LOOSE = Measurement("STALLED", False, True, False, 180.0, None, 700, 2000, 8.0, 0.3)
REFUTED = Measurement("OPTIMAL", True, False, False, 150.0, None, 100, 300, 2.0, 0.3)
CRASHED = Measurement("CRASH", fault="exit code -9")
ALL = [STRICT, NEARLY, LOOSE, REFUTED, CRASHED]


def test_shares_carry_wilsons_interval():
    # Newcombe, Statistics in Medicine 17 (1998), table I, method 3: 81 of 263.
    found = share(81, 263)
    assert found["n"] == 81 and found["of"] == 263 and found["value"] == pytest.approx(81 / 263)
    assert (round(found["low"], 4), round(found["high"], 4)) == (0.2553, 0.3662)
    assert share(0, 0) == {"n": 0, "of": 0, "value": None, "low": 0.0, "high": 1.0}


def test_costs_charge_the_failures_to_the_solutions():
    found = costs(ALL)
    assert (found["cpu_seconds"], found["cpu_seconds_per_strict"], found["cpu_seconds_per_optimal"]) == (
        20.0,
        10.0,
        20.0,
    )
    assert found["verify_seconds"] == pytest.approx(1.2)
    assert costs([LOOSE])["cpu_seconds_per_strict"] is None


def test_failures_go_by_status_unless_only_the_verifier_objected():
    assert failures(ALL) == {"STALLED": 1, NOT_VERIFIED: 1, "CRASH": 1}


def test_a_summary_counts_each_level_and_parts_successes_from_failures():
    found = summary(ALL)
    assert [found[level]["n"] for level in ("paper", "strict", "optimal")] == [3, 2, 1]
    assert found["best_propellant_kg"] == 165.0 and found["median_propellant_kg"] == 170.0
    assert found["successes"]["iterations"] == {
        "min": 300.0,
        "q1": 350.0,
        "median": 400.0,
        "q3": 450.0,
        "max": 500.0,
    }
    assert found["failures"]["cpu_seconds"]["max"] == 8.0
    # What does not arrive has burnt nothing that would mean anything.
    assert found["failures"]["propellant_kg"] is None
    assert found["faults"] == ["exit code -9"]


def test_nothing_solved_is_a_summary_too():
    found = summary([])
    assert found["strict"]["of"] == 0 and found["best_propellant_kg"] is None
    assert found["successes"]["cpu_seconds"] is None and spread([None]) is None


def test_a_spread_is_that_of_the_known_values():
    values = np.random.default_rng(1).random(9)
    found = spread([*values, None])
    assert list(found.values()) == sorted(values)[::2]
