import math

import pytest

from core.analysis.metrics import (
    delta_v_km_s,
    exhaust_velocity_km_s,
    feasibility_ratio,
    total_delta_v_km_s,
    transfer_delta_v_km_s,
    wilson_interval,
)
from core.problem import load_problem

PROBLEM = load_problem("ppe-drm3")


@pytest.mark.parametrize(
    ("n_successes", "n_trials", "low", "high"),
    [
        # The paper's Table 8 with intervals recomputed by others, in per cent to the printed digits.
        (233, 2400, 8.59, 10.96),
        (1053, 12000, 8.28, 9.29),
        (128, 4800, 2.25, 3.16),
        (3, 3600, 0.03, 0.24),
        (2, 114, 0.48, 6.2),
        # Newcombe, Statistics in Medicine 17 (1998), 857-872, Table I, score intervals.
        (81, 263, 25.53, 36.62),
        (15, 148, 6.24, 16.05),
        (0, 20, 0.0, 16.11),
    ],
)
def test_wilson_intervals_agree_with_published_ones(n_successes, n_trials, low, high):
    found = [100 * end for end in wilson_interval(n_successes, n_trials)]
    assert found == pytest.approx([low, high], abs=0.051)  # tables print one or two decimals


def test_an_interval_solves_the_score_equation_at_both_ends():
    n, s, z = 400, 37, 1.96
    for end in wilson_interval(s, n, z):
        assert (s / n - end) ** 2 == pytest.approx(z**2 * end * (1 - end) / n, rel=1e-12)  # rounding


def test_intervals_of_extreme_counts_stay_inside_zero_to_one():
    assert wilson_interval(0, 10)[0] == 0.0
    assert wilson_interval(10, 10)[1] == 1.0
    assert wilson_interval(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize(("n_successes", "n_trials"), [(-1, 10), (11, 10)])
def test_impossible_counts_are_refused(n_successes, n_trials):
    with pytest.raises(ValueError, match="counts: expected 0 <= successes <= trials"):
        wilson_interval(n_successes, n_trials)


def test_a_ratio_carries_its_interval_and_is_no_number_without_guesses():
    ratio = feasibility_ratio(3, 12)
    assert ratio.value == 0.25
    assert ratio.low < 0.25 < ratio.high
    assert math.isnan(feasibility_ratio(0, 0).value)


def test_the_exhaust_velocity_is_that_of_the_paper():
    assert exhaust_velocity_km_s(PROBLEM.spacecraft) == pytest.approx(26.55465, abs=5e-6)  # printed digits


def test_delta_v_of_the_papers_masses_is_the_papers_delta_v():
    # 2,038 kg in all are 3.878 km/s; 309 kg from 13,271 kg are 0.626 km/s; printed to three decimals.
    assert total_delta_v_km_s(PROBLEM, 15000.0 - 2038.0) == pytest.approx(3.878, abs=1e-3)
    assert transfer_delta_v_km_s(PROBLEM, 13271.0, 13271.0 - 309.0) == pytest.approx(0.626, abs=1e-3)


def test_spiral_and_transfer_add_up_to_the_mission():
    spiral = delta_v_km_s(PROBLEM.spacecraft, 15000.0, 13276.04)
    transfer = transfer_delta_v_km_s(PROBLEM, 13276.04, 12962.0)
    assert spiral + transfer == pytest.approx(total_delta_v_km_s(PROBLEM, 12962.0), rel=1e-14)  # rounding
    assert total_delta_v_km_s(PROBLEM, 0.0) == math.inf
