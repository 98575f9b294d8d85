import math

import numpy as np
import pytest

from core.analysis.metrics import (
    delta_v_km_s,
    exhaust_velocity_km_s,
    feasibility_ratio,
    product_ratio,
    spread,
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


def test_the_spread_of_one_to_five_is_that_of_the_textbook():
    found = spread([3.0, 1.0, 5.0, 2.0, 4.0])
    half_width = 2.776445 * math.sqrt(2.5 / 5)  # Student's t for 4 degrees of freedom, seven digits
    assert found[1:4] == pytest.approx((3.0, 3.0 - half_width, 3.0 + half_width), rel=1e-6)
    assert found[4:] == (1.0, 2.0, 3.0, 4.0, 5.0)


def test_one_number_has_no_interval_and_none_no_mean():
    assert math.isnan(spread([7.0]).mean_low) and spread([7.0]).median == 7.0
    assert spread([]).n == 0 and math.isnan(spread([]).mean)


def test_the_product_of_one_ratio_is_that_ratio():
    ratio = feasibility_ratio(13, 77)
    assert product_ratio([ratio]) == pytest.approx(ratio, rel=1e-14)  # rounding


def test_large_samples_give_a_product_the_log_delta_interval():
    n = 10**8
    found = product_ratio([feasibility_ratio(n // 10, n), feasibility_ratio(n // 2, n)])
    deviation = 1.96 * math.sqrt(0.9 / (0.1 * n) + 0.5 / (0.5 * n))
    assert found.value == pytest.approx(0.05, rel=1e-14)  # rounding
    ends = [math.log(found.value / found.low), math.log(found.high / found.value)]
    assert ends == pytest.approx([deviation, deviation], rel=1e-3)  # the next order is 1/sqrt(n p)


def test_the_interval_of_a_product_covers_it_as_often_as_it_says():
    rng, truth = np.random.default_rng(5), 0.097 * 0.34
    draws = zip(rng.binomial(2400, 0.097, 2000), rng.binomial(60, 0.34, 2000), strict=True)
    found = [product_ratio([feasibility_ratio(s, 2400), feasibility_ratio(t, 60)]) for s, t in draws]
    coverage = np.mean([one.low <= truth <= one.high for one in found])
    assert coverage == pytest.approx(0.95, abs=0.02)  # four deviations of 2,000 draws


def test_a_product_with_no_successes_has_an_upper_end_alone():
    found = product_ratio([feasibility_ratio(0, 20), feasibility_ratio(5, 10)])
    assert found[:2] == (0.0, 0.0)
    assert found.high == pytest.approx(wilson_interval(0, 20)[1] * wilson_interval(5, 10)[1], rel=1e-15)
    assert math.isnan(product_ratio([feasibility_ratio(0, 0), feasibility_ratio(5, 10)]).value)
