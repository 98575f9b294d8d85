"""What a set of outages covers, against closed forms at a constant rate and simulated histories."""

import itertools

import numpy as np
import pytest

from core.analysis.safe_modes import RECOVERIES, SAFE_MODES, Weibull, count_distribution, coverage
from core.problem import load_problem
from core.transcription import layout_of

PRESET = load_problem("ppe-drm3").model_copy(update={"n_segments": 10})
COAST, H = 7.0, 5.0
#: Segments 3, 4 and 8 coast; 1 % is less than the threshold.
THROTTLES = np.array([1.0, 0.5, 0.0, 0.01, 1.0, 1.0, 0.03, 0.0, 1.0, 1.0])
OUTAGES = ((2, 1.0), (5, 2.0), (5, 4.0), (8, 3.0))
ARC = COAST + 10 * H


def flown(outages=OUTAGES, throttles=THROTTLES, coast=COAST):
    problem = PRESET.with_outages(outages)
    layout = layout_of(problem)
    x = np.ones(layout.n_variables)
    own = layout.reference
    x[[own.shooting_time, own.initial_coast, own.final_coast]] = 10 * H, coast, 9.0
    x[own.controls] = np.outer(throttles, [1.0, 0.0, 0.0]).ravel()
    return problem, x


def share_of_single_modes(covered_days, rate=1 / 100.0):
    """Probability that one safe mode begins within so many days and no other on the arc, constant rate."""
    return rate * covered_days * np.exp(-rate * ARC)


def test_at_a_constant_rate_segments_count_by_their_length():
    found = coverage(*flown(), Weibull(100.0, 1.0), Weibull(2.0, 1.0))
    # Three segments and the initial coast miss nothing; of those at 2 and 5 the short ones are covered.
    harmless = COAST + 3 * H
    covered = harmless + H * (1.0 - np.exp(-0.5)) + H * (1.0 - np.exp(-2.0))
    assert found.none == pytest.approx(np.exp(-ARC / 100.0), rel=1e-12)  # rounding
    assert found.one_covered == pytest.approx(share_of_single_modes(covered), abs=1e-10)  # quadrature
    assert found.one == pytest.approx(share_of_single_modes(ARC), abs=1e-10)  # quadrature
    assert found.arc_days == ARC


def test_a_safe_mode_on_a_coast_may_last_into_thrust():
    found = coverage(*flown(), Weibull(100.0, 1.0), Weibull(2.0, 1.0), counted="lasting")

    def short(before, allowed):
        # Days of a coast, before the thrust that follows, whose safe modes are over in time.
        return before - np.exp(-allowed / 2.0) * 2.0 * (1.0 - np.exp(-before / 2.0))

    coasts = short(COAST, 0.0) + short(2 * H, 4.0) + short(H, 0.0)
    covered = coasts + H * (1.0 - np.exp(-0.5)) + H * (1.0 - np.exp(-2.0))
    assert found.one_covered == pytest.approx(share_of_single_modes(covered), abs=1e-10)  # quadrature


def test_where_any_safe_mode_counts_coasts_need_outages_too():
    found = coverage(*flown(), Weibull(100.0, 1.0), Weibull(2.0, 1.0), counted="any")
    covered = sum(H * (1.0 - np.exp(-duration / 2.0)) for duration in (1.0, 4.0, 3.0))
    assert found.one_covered == pytest.approx(share_of_single_modes(covered), abs=1e-10)  # quadrature


def simulated(counted, n, rng):
    """Return the shares of histories: none, one covered, one uncovered, several safe modes."""
    starts = np.cumsum(SAFE_MODES.sample(rng, (n, 30)), axis=1)
    how_many = np.sum(starts <= ARC, axis=1)
    at, over = starts[:, 0], starts[:, 0] + RECOVERIES.sample(rng, n)
    segment = np.floor((at - COAST) / H).astype(int) + 1  # 0 and less on the initial coast
    is_covered = np.zeros(n, bool)
    for i in np.flatnonzero(how_many == 1):
        thrusting = [s for s in range(1, 11) if THROTTLES[s - 1] > 0.02 or counted == "any"]
        first = max(segment[i], 0)
        if counted == "lasting":
            first = next((s for s in range(first, 11) if s in thrusting), 11)
        allowed = max((duration for s, duration in OUTAGES if s == first), default=0.0)
        missed_from = max(at[i], COAST + (first - 1) * H) if first > 0 else at[i]
        is_harmless = first not in thrusting and counted != "any"
        is_covered[i] = is_harmless or over[i] - missed_from <= allowed
    one = how_many == 1
    return [
        np.mean(how_many == 0),
        np.mean(one & is_covered),
        np.mean(one & ~is_covered),
        np.mean(how_many > 1),
    ]


@pytest.mark.parametrize("counted", ["thrusting", "lasting", "any"])
def test_coverage_is_that_of_simulated_histories(counted):
    n = 20_000
    seen = simulated(counted, n, np.random.default_rng(5))
    found = coverage(*flown(), counted=counted)
    expected = np.array([found.none, found.one_covered, found.one_uncovered, found.several])
    assert np.sum(expected) == pytest.approx(1.0, abs=1e-15)  # rounding
    assert np.all(
        np.abs(seen - expected) < 4.0 * np.sqrt(expected * (1.0 - expected) / n)
    )  # binomial, 4 sigma


def test_one_and_several_are_the_counts_of_the_arc():
    found, counts = coverage(*flown()), count_distribution(ARC, 1)
    assert found.one == pytest.approx(counts.probabilities[1], abs=1e-10)  # two ways to integrate
    assert found.several == pytest.approx(1.0 - counts.at_most_one, abs=1e-10)  # two ways to integrate


def test_a_trajectory_that_never_thrusts_is_covered_whenever_at_most_one_safe_mode_begins():
    problem, x = flown((), np.zeros(10))
    found = coverage(problem, x, counted="lasting")
    assert found.covered == pytest.approx(count_distribution(ARC, 1).at_most_one, abs=1e-10)  # as above
    assert found.one_uncovered == 0.0


def test_without_outages_thrust_covers_nothing():
    problem, x = flown((), np.ones(10), coast=0.0)
    assert coverage(problem, x).covered == coverage(problem, x).none


def test_each_outage_and_each_day_of_it_cover_more():
    longer = ((2, 1.0), (5, 6.0), (8, 3.0))
    more = (*longer, (9, 1.0))
    found = [coverage(*flown(outages)).covered for outages in ((), OUTAGES, longer, more)]
    assert all(first < second for first, second in itertools.pairwise(found))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"counted": "all"}, "counted: expected one of thrusting, lasting, any, got 'all'"),
        ({"throttle_threshold": 1.0}, "throttle_threshold: expected 0 <= threshold < 1, got 1.0"),
    ],
)
def test_options_that_are_unknown_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        coverage(*flown(), **options)


def test_a_vector_of_another_problem_is_refused():
    with pytest.raises(ValueError, match="decision vector: expected shape"):
        coverage(PRESET.with_outages(()), flown()[1])
