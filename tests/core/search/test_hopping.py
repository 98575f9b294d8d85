"""The law of the hop, the order in which outcomes beat each other, and what a chain does with them."""

import itertools

import numpy as np
import pytest
from scipy.stats import kstest

from core.nlp import ExitStatus, Outcome
from core.search import Chain, hop, is_better, sample_guess
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


def test_feasible_beats_infeasible_whatever_the_mass():
    assert is_better(outcome(0.9, 12000.0), outcome(1.1, 13000.0))
    assert not is_better(outcome(1.1, 13000.0), outcome(0.9, 12000.0))


def test_of_two_feasible_outcomes_the_heavier_wins_and_of_two_infeasible_the_closer():
    assert is_better(outcome(0.9, 12001.0), outcome(0.1, 12000.0))
    assert is_better(outcome(5.0, 11000.0), outcome(6.0, 13000.0))
    assert is_better(outcome(1e9, 1.0), None)


def test_the_order_is_total_and_ties_keep_the_incumbent():
    values = [(0.1, 2.0), (0.9, 2.0), (0.5, 1.0), (1.5, 9.0), (3.0, 9.0), (np.inf, 9.0)]
    outcomes = [outcome(*value) for value in values]
    assert not any(is_better(one, one) for one in outcomes)
    for a, b in itertools.combinations(outcomes, 2):
        assert not (is_better(a, b) and is_better(b, a))
    for a, b, c in itertools.permutations(outcomes, 3):
        assert is_better(a, c) or not (is_better(a, b) and is_better(b, c))


@pytest.fixture
def chain():
    return Chain(transcription((), 9), hop_width=0.05, max_failures=2)


def test_a_chain_starts_with_a_draw_from_its_law(chain):
    expected = sample_guess(chain.transcription, np.random.default_rng(3), "uniform")
    np.testing.assert_array_equal(chain.ask(np.random.default_rng(3)), expected)


def test_a_chain_hops_from_its_incumbent(chain):
    start = sample_guess(chain.transcription, np.random.default_rng(3))
    assert chain.tell(outcome(0.5, 12000.0, start)) == "accepted"
    bounds = chain.transcription.bounds
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


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"guess_law": "normal"}, r"guess law: expected one of uniform, .*, got 'normal'"),
        ({"hop_law": "levy"}, r"hop law: expected one of uniform, got 'levy'"),
        ({"hop_width": 0.0}, r"hop width: expected a number in \(0, 1\], got 0\.0"),
        ({"hop_width": float("nan")}, r"hop width: .*, got nan"),
        ({"max_failures": 0}, "max_failures: expected at least 1, got 0"),
    ],
)
def test_an_impossible_chain_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        Chain(transcription((), 9), **options)
