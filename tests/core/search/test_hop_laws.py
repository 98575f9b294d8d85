"""Every hop law against its distribution as SciPy has it, and what the EMTG preset is known to do."""

import numpy as np
import pytest
from scipy.stats import cauchy, kstest, norm, pareto, uniform

from core.search import HOP_LAWS, HopSettings, draw_steps
from core.search.hopping import LONGEST_STEP
from core.search.settings import SHAPES

N = 200_000


class BidirectionalPareto:
    """Half the mass on either side of zero, each half SciPy's Pareto law."""

    def __init__(self, shape, width):
        self.half = pareto(shape, scale=width)

    def cdf(self, r):
        return np.where(r > 0, 0.5 + 0.5 * self.half.cdf(r), 0.5 * self.half.sf(-r))

    def ppf(self, p):
        return np.where(p > 0.5, self.half.ppf(2 * p - 1), -self.half.isf(np.minimum(2 * p, 1)))

    def pdf(self, r):
        return 0.5 * self.half.pdf(np.abs(r))


#: Law, width, shape, distribution; width and shape None where the law's own are under test.
LAWS = [
    ("uniform", None, None, uniform(-0.1, 0.2)),
    ("uniform", 0.02, None, uniform(-0.02, 0.04)),
    ("gaussian", None, None, norm(scale=0.05)),
    ("gaussian", 0.3, None, norm(scale=0.3)),
    ("cauchy", None, None, cauchy(scale=1e-3)),
    ("cauchy", 0.1, None, cauchy(scale=0.1)),
    ("pareto", None, None, BidirectionalPareto(1 / 1.4, 2.52e-6)),
    ("pareto", 0.01, 2.5, BidirectionalPareto(2.5, 0.01)),
]
NAMES = [f"{law}-{width}-{shape}" for law, width, shape, _ in LAWS]


def steps(law, width=None, shape=None, n=N):
    return draw_steps(law, n, np.random.default_rng(2026), width, shape)


def test_every_law_is_tested():
    assert {law for law, *_ in LAWS} == set(HOP_LAWS)


@pytest.mark.parametrize(("law", "width", "shape", "expected"), LAWS, ids=NAMES)
def test_the_quantiles_of_a_law_are_those_of_its_formula(law, width, shape, expected):
    # The median of the Pareto law is a gap, with a quantile on either side of it.
    p = np.array([0.01, 0.25, 0.45, 0.55, 0.75, 0.99] + ([0.5] if law != "pareto" else []))
    exact = expected.ppf(p)
    # Standard error of a quantile, five of them.
    error = np.sqrt(p * (1 - p) / N) / expected.pdf(exact)
    assert np.all(np.abs(np.quantile(steps(law, width, shape), p) - exact) < 5 * error)


@pytest.mark.parametrize(("law", "width", "shape", "expected"), LAWS, ids=NAMES)
def test_a_law_is_symmetric_and_its_own_everywhere(law, width, shape, expected):
    found = steps(law, width, shape)
    # 0.5/sqrt(N) is the deviation of a share; five of them.
    assert np.mean(found > 0) == pytest.approx(0.5, abs=2.5 / np.sqrt(N))
    # A sample of the law itself passes with probability 1 - 1e-4.
    assert kstest(found, expected.cdf).pvalue > 1e-4


@pytest.mark.parametrize("law", HOP_LAWS)
def test_steps_follow_each_other_without_memory(law):
    signs = np.sign(steps(law))
    sizes = np.argsort(np.argsort(np.abs(steps(law)))) / N - 0.5
    for series in (signs, sizes):
        # The correlation of independent numbers deviates by 1/sqrt(N); five of them.
        assert abs(np.corrcoef(series[1:], series[:-1])[0, 1]) < 5 / np.sqrt(N)
    assert abs(np.corrcoef(signs, sizes)[0, 1]) < 5 / np.sqrt(N)


def test_the_width_scales_a_law():
    for law in HOP_LAWS:
        # One rounding each.
        np.testing.assert_allclose(steps(law, 0.3, n=100), 3 * steps(law, 0.1, n=100), rtol=1e-14)


#: P(|r| > step) of the Pareto laws that EMTG's steps follow with alpha 1.4 and 1.3, to two digits.
EMTG = [
    (None, None, 0.01, 2.7e-3),
    (None, None, 0.1, 5.2e-4),
    (None, None, 1.0, 1.0e-4),
    (3.78e-5, 1 / 1.3, 0.1, 2.3e-3),
]


@pytest.mark.parametrize(("width", "shape", "step", "share"), EMTG)
def test_the_pareto_law_jumps_as_far_as_often_as_emtg(width, shape, step, share):
    n = 10 * N
    # Two digits, and five deviations of a share.
    tolerance = 0.05 * share + 5 * np.sqrt(share / n)
    assert np.mean(np.abs(steps("pareto", width, shape, n)) > step) == pytest.approx(share, abs=tolerance)


def test_the_pareto_preset_moves_some_variable_by_a_tenth_in_8_of_100_hops():
    farthest = np.abs(steps("pareto", n=154 * 10_000)).reshape(-1, 154).max(axis=1)
    # Two digits and 0.5/sqrt(10,000) = 0.005, three deviations.
    assert np.mean(farthest > 0.1) == pytest.approx(0.08, abs=0.01)
    assert np.mean(farthest > 0.01) == pytest.approx(0.34, abs=0.02)


class Extreme:
    """Stands for a generator that returns the least number it may."""

    def random(self, n):
        return np.zeros(n)

    def standard_normal(self, n):
        return np.full(n, -9.0)


@pytest.mark.parametrize("law", HOP_LAWS)
def test_the_rarest_draw_is_still_a_number(law):
    assert np.all(np.isfinite(draw_steps(law, 3, Extreme(), 1.0)))


def test_the_heaviest_tail_is_cut_and_not_infinite():
    found = steps("pareto", 1.0, SHAPES[0])
    assert np.abs(found).max() == LONGEST_STEP


@pytest.mark.parametrize("law", HOP_LAWS)
def test_a_law_of_its_own_width_and_shape_may_be_chosen_and_adapted(law):
    own = HopSettings(hop_law=law, adaptive=True)
    assert (own.width, own.shape) == (HOP_LAWS[law].width, HOP_LAWS[law].shape)
