"""Maps and curves of made-up recoveries, by hand, and what they are worth against simulated histories."""

import numpy as np
import pytest

from core.analysis.missed_thrust import Attempt, attempt, fragile_segments, missed_thrust, survivability
from core.analysis.safe_modes import RECOVERIES, SAFE_MODES, Weibull
from core.problem import Outage, load_problem
from core.transcription import layout_of

PRESET = load_problem("ppe-drm3").model_copy(update={"n_segments": 10})
COAST, H, MASS = 7.0, 5.0, 13000.0
#: Segment 3 coasts, and the last one.
THROTTLES = np.array([1.0, 0.5, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0])


def flown():
    """Return a reference of ten segments, each five days long."""
    controls = np.outer(THROTTLES, [1.0, 0.0, 0.0]).ravel()
    return np.array([10 * H, COAST, 9.0, *controls, MASS])


def tried(segment, days, cost=None, late=0.0):
    recovered = None if cost is None else (MASS - cost, COAST + 9 * H + late)
    return Attempt(Outage(segment=segment, duration_days=days), recovered)


def found(*attempts):
    return missed_thrust(PRESET, flown(), attempts)


def test_a_recovery_from_a_longer_outage_is_one_from_a_shorter():
    known = found(tried(4, 1.0), tried(4, 2.0, 3.0, 0.5), tried(4, 3.0))
    np.testing.assert_allclose(known.propellant_kg, [[3.0, 3.0, np.nan]])
    np.testing.assert_allclose(known.delay_days, [[0.5, 0.5, np.nan]], atol=1e-12)  # rounding
    assert known.longest_days == pytest.approx([2.0]) and not known.is_open[0]


def test_of_several_recoveries_the_cheapest_counts():
    known = found(tried(4, 1.0, 5.0), tried(4, 1.0, 2.0, 1.5), tried(4, 1.0), tried(4, 1.0, 4.0))
    assert known.propellant_kg == pytest.approx(2.0) and known.delay_days == pytest.approx(1.5)


def test_the_cost_never_falls_with_the_duration():
    rng = np.random.default_rng(3)
    grid = [(n, d) for n in (1, 4, 7) for d in (0.5, 1.0, 1.5, 2.0, 2.5)]
    known = found(*(tried(n, d, rng.choice([None, 9.0 * rng.random()])) for n, d in grid))
    for row in known.propellant_kg:
        solved = row[np.isfinite(row)]
        assert np.all(np.diff(solved) >= 0.0) and np.all(np.isfinite(row[: len(solved)]))


def test_a_cell_that_nobody_tried_is_told_from_one_without_a_recovery():
    known = found(tried(4, 1.0, 0.1), tried(6, 1.0), tried(6, 2.0))
    assert known.is_tried.tolist() == [[True, False], [True, True]]
    assert known.is_open.tolist() == [False, False] and known.longest_days.tolist() == [1.0, 0.0]


def test_segments_are_told_with_their_epochs_and_throttles():
    known = found(tried(2, 1.0), tried(3, 1.0, 0.0))
    assert known.starts_days == pytest.approx([COAST + H, COAST + 2 * H])
    assert known.throttles.tolist() == [0.5, 0.0]
    assert known.arrival_days == pytest.approx(COAST + 9 * H)  # the last segment coasts


def test_a_solution_of_p_1_tells_mass_and_last_burn_of_its_recovery():
    problem = PRESET.with_outages([(4, 1.5)])
    own = layout_of(problem).trajectories[1]
    x = np.concatenate([flown(), np.zeros(own.stop - own.offset)])
    x[own.shooting_time], x[own.initial_coast], x[own.final_mass] = 30.0, 2.0, 12990.0
    x[own.control(5)] = 0.7
    # It starts at segment 4, coasts 1.5 + 2 days, and the fifth of six segments of five days is the last lit.
    assert attempt(problem, x).recovered == pytest.approx((12990.0, COAST + 3 * H + 3.5 + 25.0))
    assert attempt(problem, None).recovered is None


def test_attempts_need_one_outage_each_and_an_analysis_an_attempt():
    with pytest.raises(ValueError, match="expected one outage, got 2"):
        attempt(PRESET.with_outages([(4, 1.0), (5, 1.0)]), None)
    with pytest.raises(ValueError, match="attempts: expected at least one outage, got none"):
        found()


ANALYSIS = [
    tried(n, d, 1.0 if d <= longest else None) for n, longest in ((1, 4), (4, 1), (8, 2)) for d in (1, 2, 4)
]
#: What each segment takes: between those that were tried, the less; the coasts take what follows them.
ALLOWED = [4.0, 1.0, None, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, None]


def simulated(n, rng):
    """Return the shares of histories with none, one recovered and one lost safe mode."""
    arc = COAST + 10 * H
    starts = np.cumsum(SAFE_MODES.sample(rng, (n, 30)), axis=1)
    is_one = np.sum(starts <= arc, axis=1) == 1
    at, lasts = starts[is_one, 0], RECOVERIES.sample(rng, is_one.sum())
    segment = np.floor((at - COAST) / H).astype(int)  # from 0; less on the initial coast
    bounds = np.empty(len(at))
    for i, (t, s) in enumerate(zip(at, segment, strict=True)):
        first = 0 if s < 0 else (3 if s == 2 else s)
        wait = max(0.0, COAST + first * H - t) if first != s else 0.0
        bounds[i] = np.inf if ALLOWED[first] is None else wait + ALLOWED[first]
    return np.mean(starts[:, 0] > arc), np.mean(is_one) * np.mean(lasts <= bounds), np.mean(is_one)


def test_survivability_is_that_of_simulated_histories():
    chance = survivability(PRESET, flown(), found(*ANALYSIS))
    n = 40_000
    none, recovered, one = simulated(n, np.random.default_rng(5))
    three_sigma = 3.0 * np.sqrt(0.25 / n)
    assert chance.least.none == pytest.approx(none, abs=three_sigma)
    assert chance.least.one == pytest.approx(one, abs=three_sigma)
    assert chance.least.one_covered == pytest.approx(recovered, abs=three_sigma)
    assert chance.lost.sum() == pytest.approx(chance.least.one_uncovered, abs=1e-9)  # quadrature
    assert chance.most.one_covered > chance.least.one_covered  # segment 1 takes the longest


def test_at_a_constant_rate_a_segment_loses_by_its_length_and_its_longest_outage():
    chance = survivability(PRESET, flown(), found(*ANALYSIS), Weibull(100.0, 1.0), Weibull(2.0, 1.0))
    alone = 0.01 * H * np.exp(-0.01 * (COAST + 10 * H))
    assert chance.lost[4] == pytest.approx(alone * np.exp(-1.0 / 2.0), abs=1e-10)  # quadrature
    assert chance.lost[8] == pytest.approx(alone * np.exp(-2.0 / 2.0), abs=1e-10)  # quadrature
    assert chance.lost[10] == 0.0  # nothing is missed on the last coast


def test_fragile_are_thrusting_segments_that_do_not_take_the_median_outage():
    known = found(*ANALYSIS, tried(3, 1.0), tried(6, 1.0))
    # The median is 1.78 days; segment 3 coasts, 8 takes two days.
    assert fragile_segments(PRESET, flown(), known) == [6, 4]
