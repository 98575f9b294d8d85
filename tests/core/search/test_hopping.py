"""The law of the hop, the order in which outcomes beat each other, and what a chain does with them."""

import dataclasses
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import kstest

from core.nlp import ExitStatus, Outcome
from core.search import (
    HOP_LAWS,
    Chain,
    HopAddress,
    HopSettings,
    hop,
    hop_rng,
    hop_times,
    is_better,
    sample_guess,
)
from core.transcription import Layout, TrajectoryLayout
from tests.core.transcription.points import transcription

LOWER, UPPER = np.array([-2.0, -np.pi, -1.5]), np.array([6.0, np.pi, 1.5])


def hops(x, width, n=4000, rng_seed=1):
    rng = np.random.default_rng(rng_seed)
    return np.array([hop(np.array(x), (LOWER, UPPER), "uniform", width, rng) for _ in range(n)])


def outcome(violation, objective, x=None):
    x = np.zeros(3) if x is None else x
    return Outcome(ExitStatus.OPTIMAL, x, objective, violation, np.zeros((1, 7)), 1, 1, 0.0)


def test_a_uniform_hop_reaches_every_place_within_its_width_alike():
    moved = hops([2.0, 0.0, 0.0], 0.1) - [2.0, 0.0, 0.0]
    for component, width in zip(moved.T, UPPER - LOWER, strict=True):
        # A sample of the law itself passes with probability 1 - 1e-4 per component.
        uniform = kstest(component, "uniform", args=(-0.1 * width, 0.2 * width))
        assert uniform.pvalue > 1e-4
        assert np.abs(component).max() <= 0.1 * width


def test_components_hop_independently_of_each_other():
    correlation = np.corrcoef(hops([2.0, 0.0, 0.0], 0.1).T)
    # 1/sqrt(4000) = 0.016; five deviations.
    assert np.abs(correlation - np.eye(3)).max() < 0.08


def test_a_hop_beyond_a_bound_ends_on_it():
    moved = hops([6.0, 0.0, -1.5], 0.2)
    assert np.all((moved >= LOWER) & (moved <= UPPER))
    # Half of all hops from a bound lead out; 0.5/sqrt(4000) = 0.008, five deviations.
    assert np.mean(moved[:, 0] == 6.0) == pytest.approx(0.5, abs=0.04)
    assert np.mean(moved[:, 2] == -1.5) == pytest.approx(0.5, abs=0.04)


def test_an_in_plane_angle_wraps_around():
    moved = hops([2.0, 3.1, 0.0], 0.1)[:, 1]
    turned = (moved - 3.1 + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(turned).max() <= 0.2 * np.pi + 1e-12  # rounding of the remainder
    assert np.any(moved < -2.5) and not np.any(np.abs(moved) == np.pi)


@pytest.mark.parametrize("law", HOP_LAWS)
def test_hops_of_every_law_and_width_stay_inside(law):
    rng = np.random.default_rng(7)
    fixed = LOWER.copy(), np.where(LOWER == -1.5, LOWER, UPPER)
    for bounds, width in itertools.product(((LOWER, UPPER), fixed), (1e-6, 0.1, 1.0)):
        x = bounds[0] + (bounds[1] - bounds[0]) * rng.random(3)
        moved = np.array([hop(x, bounds, law, width, rng) for _ in range(500)])
        assert np.all((moved >= bounds[0]) & (moved <= bounds[1]))


def test_a_step_of_a_million_widths_ends_on_a_bound_or_at_some_angle():
    class Farthest:
        def random(self, n):
            return np.full(n, 1.0 - 2.0**-53)

    moved = hop(np.array([2.0, 1.0, 0.0]), (LOWER, UPPER), "pareto", 1.0, Farthest(), 0.1)
    # A million whole turns lead back; the angle has 2 pi 1e6 eps = 1.4e-9 left of its digits.
    np.testing.assert_allclose(moved, [6.0, 1.0, 1.5], atol=2e-9)


def test_each_time_is_drawn_afresh_as_often_as_told_and_nothing_else_moves():
    x, times, rng = np.array([2.0, 0.5, 0.25]), np.array([0, 2]), np.random.default_rng(8)
    moved = np.array([hop_times(x, (LOWER, UPPER), times, 0.3, rng) for _ in range(4000)])
    assert np.all(moved[:, 1] == 0.5)
    redrawn = moved != x
    # sqrt(0.3 * 0.7/4000) = 0.007; five deviations, of both times and of both together.
    assert redrawn.mean(axis=0) == pytest.approx([0.3, 0.0, 0.3], abs=0.036)
    assert np.all(redrawn[:, ::2], axis=1).mean() == pytest.approx(0.09, abs=0.023)
    for time in times:
        fresh = moved[redrawn[:, time], time]
        # A sample of the law itself passes with probability 1 - 1e-4.
        assert kstest(fresh, "uniform", args=(LOWER[time], (UPPER - LOWER)[time])).pvalue > 1e-4


def test_feasible_beats_infeasible_whatever_the_mass():
    assert is_better(outcome(0.9, 12000.0), outcome(1.1, 13000.0))
    assert not is_better(outcome(1.1, 13000.0), outcome(0.9, 12000.0))


def test_of_two_feasible_outcomes_the_heavier_wins_and_of_two_infeasible_the_closer():
    assert is_better(outcome(0.9, 12001.0), outcome(0.1, 12000.0))
    assert is_better(outcome(5.0, 11000.0), outcome(6.0, 13000.0))
    assert is_better(outcome(1e9, 1.0), None)


def test_the_order_is_total_and_ties_keep_the_incumbent():
    values = [(0.1, 2.0), (0.9, 2.0), (0.5, 1.0), (1.5, 9.0), (3.0, 9.0), (np.inf, 9.0)]
    values += [(np.nan, 9.0), (0.2, np.nan), (0.2, -np.inf)]
    outcomes = [outcome(*value) for value in values]
    assert not any(is_better(one, one) for one in outcomes)
    for a, b in itertools.combinations(outcomes, 2):
        assert not (is_better(a, b) and is_better(b, a))
    for a, b, c in itertools.permutations(outcomes, 3):
        assert is_better(a, c) or not (is_better(a, b) and is_better(b, c))


def test_what_is_not_a_number_is_beaten_by_all_that_is():
    assert is_better(outcome(1e9, 1.0), outcome(np.nan, 9.0))
    assert not is_better(outcome(np.nan, 9.0), outcome(1e9, 1.0))
    assert is_better(outcome(0.5, 1.0), outcome(0.5, np.nan))
    assert is_better(outcome(0.5, np.nan), outcome(1.5, 9.0))


@pytest.fixture
def chain():
    return Chain(transcription((), 9), HopSettings(hop_width=0.05, max_failures=2))


def test_a_chain_starts_with_a_draw_from_its_law(chain):
    expected = sample_guess(chain.transcription, np.random.default_rng(3), "uniform")
    np.testing.assert_array_equal(chain.ask(np.random.default_rng(3)), expected)


@pytest.mark.parametrize("violation", [0.5, 1e6])
def test_a_chain_hops_from_its_incumbent_feasible_or_not(chain, violation):
    start = sample_guess(chain.transcription, np.random.default_rng(3))
    assert chain.tell(outcome(violation, 12000.0, start)) == "accepted"
    bounds = chain.transcription.sampling_box
    expected = hop(start, bounds, "uniform", 0.05, np.random.default_rng(4))
    np.testing.assert_array_equal(chain.ask(np.random.default_rng(4)), expected)


def test_a_chain_takes_what_is_better_and_starts_afresh_after_failures(chain):
    told = [(5.0, 0.0), (6.0, 0.0), (4.0, 0.0), (0.5, 12000.0), (0.5, 11000.0), (0.5, 12000.0)]
    said = [chain.tell(outcome(*values)) for values in told]
    assert said == ["accepted", "rejected", "accepted", "accepted", "rejected", "restarted"]
    assert chain.incumbent is None and chain.failures == 0
    expected = sample_guess(chain.transcription, np.random.default_rng(5))
    np.testing.assert_array_equal(chain.ask(np.random.default_rng(5)), expected)


def test_a_chain_does_not_hop_from_what_could_not_be_flown(chain):
    chain.tell(outcome(np.inf, 0.0, np.full(31, np.nan)))
    assert np.isfinite(chain.ask(np.random.default_rng(6))).all()


#: Ten variables with two segments of control.
SMALL = SimpleNamespace(
    sampling_box=(
        np.array([0.0, 0.0, 0.0] + [0.0, -np.pi, -1.5] * 2 + [1.0]),
        np.array([90.0, 30.0, 30.0] + [1.0, np.pi, 1.5] * 2 + [13.0]),
    ),
    layout=Layout((TrajectoryLayout(0, 2, None),)),
)


def trained(settings, told):
    """Return a chain that was told violations, and the widths that it had."""
    chain = Chain(SMALL, settings)
    widths = [chain.width]
    for violation in told:
        chain.tell(outcome(violation, 0.0))
        widths.append(chain.width)
    return chain, np.array(widths)


def test_the_width_of_an_adaptive_chain_follows_its_successes():
    settings = HopSettings(adaptive=True, hop_width=0.2, max_failures=3)
    # A draw, success, failure, success, failures up to a restart, a draw, success.
    _, widths = trained(settings, [9.0, 8.0, 8.5, 7.0, 7.5, 7.5, 7.5, 9.0, 8.0])
    better, worse = np.exp(0.3 * 0.95), np.exp(-0.3 * 0.05)
    up, down = 0.2 * better, 0.2 * better * worse
    grown = down * better
    expected = [0.2, 0.2, up, down, grown, grown * worse, grown * worse**2, 0.2, 0.2, up]
    np.testing.assert_allclose(widths, expected, rtol=1e-14)  # rounding


def test_a_success_of_one_in_twenty_leaves_an_adaptive_width_as_it_was():
    told = np.repeat(100.0 - np.arange(20), 20)
    _, widths = trained(HopSettings(adaptive=True, max_failures=99), [101.0, *told])
    # Twenty successes, twenty times nineteen failures: four hundred roundings.
    assert widths[-1] == pytest.approx(widths[0], rel=1e-12)


#: Least and greatest width: of the Pareto law x_m times 100^(1/a), below which 99 % of steps are, is kept.
RANGES = [
    ({"hop_law": "uniform"}, 1e-4, 0.5),
    ({"hop_law": "gaussian"}, 1e-4, 0.5),
    ({"hop_law": "cauchy"}, 1e-4, 0.5),
    ({"hop_law": "pareto"}, 1e-4 / 100**1.4, 0.5 / 100**1.4),
    ({"hop_law": "pareto", "hop_width": 0.01, "hop_shape": 2.0}, 1e-5, 0.05),
]


@pytest.mark.parametrize(("options", "low", "high"), RANGES)
def test_an_adaptive_width_is_kept_in_its_range(options, low, high):
    settings = HopSettings(adaptive=True, max_failures=10**6, **options)
    assert trained(settings, 1e3 - np.arange(60.0))[1][-1] == pytest.approx(high, rel=1e-12)  # rounding
    assert trained(settings, [1e3] * 800)[1][-1] == pytest.approx(low, rel=1e-12)


def test_a_fresh_draw_teaches_an_adaptive_chain_nothing():
    settings = HopSettings(adaptive=True, max_failures=9)
    chain, widths = trained(settings, [np.inf, np.inf, np.nan, 5.0])
    assert np.all(widths == 0.1) and chain.incumbent.violation == 5.0


def test_a_chain_that_does_not_adapt_keeps_its_width():
    assert set(trained(HopSettings(hop_law="cauchy"), [9.0, 8.0, 8.5, 7.0])[1]) == {1e-3}


def test_an_adaptive_chain_hops_by_its_present_width():
    settings = HopSettings(hop_law="gaussian", adaptive=True)
    start = sample_guess(transcription((), 9), np.random.default_rng(3))
    chain = Chain(transcription((), 9), settings)
    for violation in (5.0, 4.0):
        chain.tell(outcome(violation, 0.0, start))
    bounds, width = chain.transcription.sampling_box, 0.05 * np.exp(0.285)
    expected = hop(start, bounds, "gaussian", width, np.random.default_rng(4))
    np.testing.assert_array_equal(chain.ask(np.random.default_rng(4)), expected)


def test_the_times_of_all_trajectories_hop_and_nothing_else():
    flown = transcription(((4, 1.0),), 9)
    chain = Chain(flown, HopSettings(hop_law="gaussian", hop_width=1e-12, time_hop_probability=1.0))
    start = sample_guess(flown, np.random.default_rng(3))
    chain.tell(outcome(0.5, 1.0, start))
    far = np.abs(chain.ask(np.random.default_rng(4)) - start) > 1e-6
    # (T_s, T_i, T_f, 9 controls, m_f), then the same with 5 segments: 31 + 19 variables.
    assert np.flatnonzero(far).tolist() == [0, 1, 2, 31, 32, 33]


def settled(guess):
    """Return the outcome of a local solver in basins a tenth of the box wide, the best about 0.35."""
    lower, upper = SMALL.sampling_box
    share = np.floor(10 * (guess - lower) / (upper - lower)).clip(0, 9) / 10 + 0.05
    distance = np.abs(share - 0.35).sum()
    return outcome(0.5 if distance < 1.5 else 1.0 + distance, -distance, lower + share * (upper - lower))


def searched(settings, n_hops=400, chain_number=0):
    chain, seen = Chain(SMALL, settings), []
    for number in range(n_hops):
        chain.tell(settled(chain.ask(hop_rng(2026, HopAddress(0, 0, 0, chain_number, number)))))
        seen.append(chain.incumbent)
    return seen


#: The widths let hops leave a basin of half width 0.05.
SEARCHES = [
    HopSettings(hop_law="uniform"),
    HopSettings(hop_law="gaussian"),
    HopSettings(hop_law="cauchy", hop_width=0.02),
    HopSettings(hop_law="pareto", hop_width=0.02, hop_shape=1.0),
    HopSettings(hop_law="uniform", hop_width=0.3, adaptive=True),
    HopSettings(hop_law="gaussian", time_hop_probability=0.05),
]


@pytest.mark.parametrize("settings", SEARCHES, ids=str)
def test_a_chain_climbs_a_funnel_of_basins_monotonically(settings):
    seen = searched(dataclasses.replace(settings, max_failures=10**6))
    for before, after in itertools.pairwise(seen):
        assert after is before or is_better(after, before)
    drawn = [settled(sample_guess(SMALL, np.random.default_rng(i))).objective for i in range(400)]
    # As many draws without hops stay far from the best, which is 0.
    assert seen[-1].is_feasible and seen[-1].objective > 0.5 * max(drawn)


def test_the_same_address_gives_the_same_chain_and_another_one_another():
    settings = HopSettings(hop_law="pareto", hop_width=0.02, adaptive=False, time_hop_probability=0.1)
    first, again, other = (searched(settings, 30, number)[-1] for number in (3, 3, 4))
    np.testing.assert_array_equal(first.x, again.x)
    assert not np.array_equal(first.x, other.x)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"guess_law": "normal"}, r"guess_law: expected one of uniform, .*, got 'normal'"),
        ({"hop_law": "levy"}, r"hop_law: expected one of uniform, gaussian, cauchy, pareto, got 'levy'"),
        ({"hop_width": 0.0}, r"hop_width: expected a number in \(0, 1\], got 0\.0"),
        ({"hop_width": float("nan")}, r"hop_width: .*, got nan"),
        ({"hop_shape": 1.0}, "hop_shape: expected none for a uniform law, got 1.0"),
        ({"hop_law": "pareto", "hop_shape": 0.0}, r"hop_shape: expected a number in \[0\.1, 10\], got 0\.0"),
        ({"hop_law": "pareto", "hop_shape": float("nan")}, "hop_shape: .*, got nan"),
        (
            {"hop_width": 0.8, "adaptive": True},
            r"hop_width: .* \[0\.0001, 0\.5\] for an adaptive uniform law",
        ),
        ({"hop_law": "pareto", "hop_width": 0.1, "adaptive": True}, r"hop_width: .* \[1\.6e-07, 0\.00079\]"),
        ({"time_hop_probability": 1.1}, r"time_hop_probability: expected a number in \[0, 1\], got 1\.1"),
        ({"time_hop_probability": float("nan")}, "time_hop_probability: .*, got nan"),
        ({"max_failures": 0}, "max_failures: expected at least 1, got 0"),
    ],
)
def test_impossible_settings_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        HopSettings(**options)


def played(settings, told, places=()):
    """Return the guesses of a chain and what it said, the chain being made anew before some of its hops."""
    chain, seen = Chain(SMALL, settings), []
    for hop_number, values in enumerate(told):
        if hop_number in places:
            chain = Chain(SMALL, settings, chain.state)
        guess = chain.ask(np.random.default_rng(hop_number))
        seen.append((guess.tobytes(), chain.tell(outcome(*values, guess))))
    return seen


@pytest.mark.parametrize("adaptive", [False, True])
def test_a_chain_that_goes_on_where_another_stood_makes_the_same_hops_bit_by_bit(adaptive):
    settings = HopSettings(hop_law="gaussian", adaptive=adaptive, max_failures=3, time_hop_probability=0.3)
    # Better and worse, feasible and not, two restarts, and what could not be flown.
    told = [
        (np.inf, np.nan),
        (5.0, 0.0),
        (4.0, 0.0),
        (4.5, 0.0),
        (0.5, 10.0),
        (0.5, 9.0),
        (0.5, 8.0),
        (0.9, 7.0),
    ]
    told = [*told, (np.nan, 1.0), (3.0, 1.0), (3.5, 1.0), (2.0, 1.0), (0.7, 11.0), (0.7, 12.0)]
    whole = played(settings, told)
    assert {said for _, said in whole} == {"accepted", "rejected", "restarted"}
    for place in range(len(told)):
        assert played(settings, told, {place}) == whole
    assert played(settings, told, set(range(len(told)))) == whole
