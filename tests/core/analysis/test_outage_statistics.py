"""Laws and counts of safe modes against tables, closed forms, SciPy and simulated histories."""

import numpy as np
import pytest
from scipy.stats import kstest, poisson, weibull_min

from core.analysis.safe_modes import (
    RECOVERIES,
    SAFE_MODES,
    Weibull,
    count_distribution,
    duration_cdf,
    quoted_statements,
)

#: Arc [days]; P(0) .. P(3), P(N <= 1), P(1 given >= 1), mean; computed by others, to three decimals.
TABLE = [
    (98.0, (0.618, 0.288, 0.077, 0.015), 0.906, 0.753, 0.50),
    (150.0, (0.499, 0.331, 0.127, 0.035), 0.829, 0.660, 0.73),
    (276.0, (0.307, 0.334, 0.212, 0.097), 0.641, 0.482, 1.27),
]


@pytest.mark.parametrize("law", [SAFE_MODES, RECOVERIES, Weibull(3.0, 4.5)])
def test_a_law_is_scipys(law):
    known = weibull_min(law.shape, scale=law.scale_days)
    days = np.array([0.1, 1.0, 20.0])
    assert law.cdf(days) == pytest.approx(known.cdf(days), rel=1e-12)  # rounding
    assert law.survival(days) == pytest.approx(known.sf(days), rel=1e-12, abs=1e-300)  # rounding
    assert law.density(days) == pytest.approx(known.pdf(days), rel=1e-12, abs=1e-300)  # rounding
    assert law.quantile([0.0, 0.3, 0.99]) == pytest.approx(known.ppf([0.0, 0.3, 0.99]), rel=1e-12)  # rounding
    assert (law.mean(), law.median()) == pytest.approx((known.mean(), known.median()), rel=1e-12)  # rounding


def test_the_two_laws_have_the_known_means_and_medians():
    assert (SAFE_MODES.mean(), SAFE_MODES.median()) == pytest.approx((244.9, 149.4), abs=0.05)  # digits given
    assert (RECOVERIES.mean(), RECOVERIES.median()) == pytest.approx((2.34, 1.78), abs=0.005)  # digits given
    assert SAFE_MODES.cdf(200.0) == pytest.approx(0.5905, abs=1e-4)  # digits given, cut off


def test_durations_have_the_known_probabilities():
    known = [0.0, 0.149, 0.300, 0.433, 0.639, 0.895]
    found = duration_cdf([0.0, 0.5, 1.0, 1.5, 2.5, 5.0])
    assert found == pytest.approx(known, abs=5e-4)  # digits given


def test_no_time_is_negative_and_each_is_exceeded_by_some():
    assert SAFE_MODES.cdf(-1.0) == 0.0 and SAFE_MODES.survival(-1.0) == 1.0
    assert SAFE_MODES.cdf(np.inf) == 1.0


def test_samples_follow_their_law():
    drawn = RECOVERIES.sample(np.random.default_rng(3), 4000)
    # The chance of a larger distance is 1 % for a right sampler; this rng_seed is fixed.
    assert kstest(drawn, weibull_min(1.144, scale=2.459).cdf).pvalue > 0.01
    assert RECOVERIES.sample(np.random.default_rng(3)).shape == ()


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf")])
def test_laws_that_cannot_be_are_refused(bad):
    with pytest.raises(ValueError, match=f"scale_days: expected a positive finite number, got {bad}"):
        Weibull(bad, 1.0)
    with pytest.raises(ValueError, match=f"shape: expected a positive finite number, got {bad}"):
        Weibull(1.0, bad)


@pytest.mark.parametrize("bad", [-0.1, 1.0, float("nan")])
def test_a_quantile_of_what_is_no_probability_is_refused(bad):
    with pytest.raises(ValueError, match=f"probability: expected 0 <= p < 1, got {bad}"):
        SAFE_MODES.quantile(bad)


@pytest.mark.parametrize(("arc", "counts", "at_most_one", "one_given_any", "mean"), TABLE)
def test_counts_on_an_arc_are_those_of_the_table(arc, counts, at_most_one, one_given_any, mean):
    found = count_distribution(arc)
    assert found.probabilities[:4] == pytest.approx(counts, abs=5.01e-4)  # digits given
    assert found.at_most_one == pytest.approx(at_most_one, abs=5e-4)  # digits given
    assert found.one_given_any == pytest.approx(one_given_any, abs=5e-4)  # digits given
    assert found.mean == pytest.approx(mean, abs=5e-3)  # digits given


@pytest.mark.parametrize("mean", [0.01, 1.0, 12.0])
def test_counts_at_a_constant_rate_are_poissons(mean):
    found = count_distribution(40.0 * mean, 30, Weibull(40.0, 1.0))
    # The agreement asked of two resolutions is 1e-10; the finer one is better.
    assert found.probabilities == pytest.approx(poisson.pmf(np.arange(31), mean), abs=1e-11)
    assert found.mean == pytest.approx(mean, abs=1e-10)  # thirteenth digits, added up over counts


@pytest.mark.parametrize(
    ("law", "arc"), [(SAFE_MODES, 276.0), (Weibull(30.0, 0.5), 60.0), (Weibull(9.0, 3.3), 30.0)]
)
def test_counts_are_those_of_simulated_histories(law, arc):
    n = 40_000
    ends = np.cumsum(weibull_min.rvs(law.shape, scale=law.scale_days, size=(n, 40), random_state=11), axis=1)
    seen = np.bincount(np.sum(ends <= arc, axis=1), minlength=41)[:7] / n
    expected = count_distribution(arc, 6, law).probabilities
    # Four binomial standard deviations, and one history for counts that nearly never occur.
    assert np.all(np.abs(seen - expected) < 4.0 * np.sqrt(expected * (1.0 - expected) / n) + 1.0 / n)


def test_the_mean_count_of_a_long_arc_is_that_of_renewal_theory():
    law, arc = Weibull(10.0, 2.0), 80.0
    known = weibull_min(2.0, scale=10.0)
    # m(T) -> T/mu + (var - mu^2)/(2 mu^2): the pole at 0 of the Laplace transform of the renewal equation.
    asymptote = arc / known.mean() + 0.5 * (known.var() / known.mean() ** 2 - 1.0)
    assert count_distribution(arc, 2, law).mean == pytest.approx(asymptote, abs=1e-9)  # it has long decayed


def test_an_arc_of_no_length_sees_nothing():
    found = count_distribution(0.0, 3)
    assert found.probabilities.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert found.mean == 0.0 and np.isnan(found.one_given_any)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-1.0,), r"arc_days: expected 0 .. 12\d\d\d"),
        ((float("nan"),), r"arc_days: expected .*got nan"),
        ((1e6,), r"50 mean times\), got 1000000"),
        ((98.0, 0), "n_max: expected at least 1, got 0"),
        ((48.0, 3, Weibull(10.0, 30.0)), "between: expected a law that degree 192 resolves on 48 days"),
    ],
)
def test_counts_that_cannot_be_had_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        count_distribution(*arguments)


def test_what_the_paper_quotes_is_computed_and_said_in_full():
    found = [(row.sentence, round(row.value, 3), row.paper) for row in quoted_statements()]
    assert found == [
        ("At most one safe mode in 98 days, which includes none.", 0.906, 0.90),
        ("No safe mode in 98 days.", 0.618, None),
        ("Exactly one in 98 days, given one or more.", 0.753, None),
        ("Exactly one safe mode in 276 days.", 0.334, 0.33),
        ("At least one safe mode in 276 days.", 0.693, None),
        ("An outage lasts at most 1.5 days.", 0.433, 0.40),
    ]


def test_what_the_paper_quotes_follows_the_laws():
    rows = quoted_statements(Weibull(100.0, 1.0), Weibull(1.5, 2.0))
    assert rows[1].value == pytest.approx(np.exp(-0.98), rel=1e-12)  # rounding
    assert rows[3].value == pytest.approx(2.76 * np.exp(-2.76), abs=1e-11)  # as above
    assert rows[5].value == pytest.approx(1.0 - np.exp(-1.0), rel=1e-12)  # rounding
