"""Ratios and hours along seed chains, by hand and against the definitions written out."""

from math import inf, isnan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.analysis.campaign_statistics import findings_of
from core.analysis.cumulative_cost import Link, cumulative_hours, cumulative_ratio, full_hours, seed_chains
from core.analysis.metrics import wilson_interval
from tests.core.analysis.solves import campaign, failed, solved

#: 10 h a solution; of 20 seeds half give one, for 4 h; of 20 solves with 4 seeds a quarter, for 8 h.
CHAIN = [Link("S(0)", 100, 20, 0, 200.0), Link("S(1|0)", 20, 10, 20, 40.0), Link("S(2|1)", 20, 5, 4, 40.0)]
LINKS = st.lists(
    st.builds(
        lambda n, share, seeds, hours: Link(
            "S(k)", n, max(1, round(n * share)), max(1, round(n * seeds)), hours
        ),
        st.integers(1, 5000),
        st.floats(0.0, 1.0),
        st.floats(0.0, 1.0),
        st.floats(1e-3, 1e5),
    ),
    min_size=1,
    max_size=4,
)


def test_ratios_are_multiplied_and_hours_added_as_the_paper_does():
    assert cumulative_ratio(CHAIN).value == pytest.approx(0.2 * 0.5 * 0.25, rel=1e-15)  # rounding
    assert cumulative_hours(CHAIN).value == pytest.approx(10.0 + 4.0 + 8.0, rel=1e-15)  # rounding


def test_the_full_cost_pays_as_many_seeds_as_it_takes_at_every_depth():
    # S(1|0): 10 / 0.5 + 4 = 24 h; S(2|1): 24 / 0.25 + 8 = 104 h.
    assert full_hours(CHAIN[:2]).value == pytest.approx(24.0, rel=1e-14)  # rounding
    assert full_hours(CHAIN).value == pytest.approx(104.0, rel=1e-14)  # rounding


def test_a_shared_seed_is_paid_once():
    # 4 seeds for 5 solutions: 24 x 4/5 + 8.
    assert full_hours(CHAIN, is_shared=True).value == pytest.approx(27.2, rel=1e-14)  # rounding


def test_the_interval_of_a_cost_without_seeds_is_that_of_its_ratio():
    low, high = wilson_interval(20, 100)
    assert full_hours(CHAIN[:1]) == pytest.approx((10.0, 2.0 / high, 2.0 / low), rel=1e-13)  # rounding


def test_without_solutions_a_cost_has_but_a_lower_end():
    links = [CHAIN[0], Link("S(1|0)", 10, 0, 10, 20.0)]
    value, low, high = full_hours(links)
    expected = (2.0 / wilson_interval(20, 100)[1] + 2.0) / wilson_interval(0, 10)[1]
    assert isnan(value) and high == inf
    assert low == pytest.approx(expected, rel=1e-14)  # rounding
    assert cumulative_ratio(links)[:2] == (0.0, 0.0)


@given(LINKS)
def test_costs_are_ordered_and_lie_in_their_intervals(links):
    added, full, shared = cumulative_hours(links), full_hours(links), full_hours(links, is_shared=True)
    rounding = 1.0 + 1e-12
    assert added.value <= full.value * rounding and shared.value <= full.value * rounding
    for low, value, high in ((one.low, one.value, one.high) for one in (added, full, shared)):
        assert 0.0 < low <= value * rounding and value <= high * rounding


def seeded(name, seed, *segments, source, k, **changes):
    return solved(name, 300.0, *segments, seeds_from=source, seed_k=k, seed_id=seed, **changes)


def test_a_chain_is_followed_from_search_to_search():
    solves = [
        *(solved("a", cpu_seconds=3600.0), failed(cpu_seconds=3600.0)),
        seeded("b", "a", 4, source="S(0)", k=0, cpu_seconds=3600.0),
        seeded("c", "b", 4, 8, source="S(1|0)", k=1, cpu_seconds=3600.0),
        failed((4, 8), seeds_from="S(1|0)", seed_k=1, seed_id="b", cpu_seconds=3600.0),
    ]
    *_, last = seed_chains(findings_of(campaign(*solves)))
    assert last.chain == "S(2|1) <- S(1|0) <- S(0)"
    assert last.ratio.value == 0.25
    assert last.hours.value == pytest.approx(2.0 + 1.0 + 2.0, rel=1e-14)  # rounding
    assert last.full_hours.value == pytest.approx((2.0 + 1.0 + 1.0) / 0.5, rel=1e-14)  # rounding
    # One seed served both solves: 3 h for it and 2 h for them, and one solution.
    assert last.shared_hours.value == pytest.approx(5.0, rel=1e-14)  # rounding


@pytest.mark.parametrize(("seed_level", "hours"), [("strict", 5.0), ("paper", 3.0)])
def test_seeds_count_at_the_level_at_which_they_are_taken(seed_level, hours):
    # Two solutions at the paper's tolerance for 4 h, of which one is strict; then one solve of 1 h.
    solves = [
        *(solved("a", cpu_seconds=7200.0), solved("b", is_strict=False, cpu_seconds=7200.0)),
        seeded("c", "a", 4, source="S(0)", k=0, seed_level=seed_level, cpu_seconds=3600.0),
    ]
    for level in ("paper", "strict"):
        found = seed_chains(findings_of(campaign(*solves)), level)[1]
        assert found.full_hours.value == pytest.approx(hours, rel=1e-14)  # rounding


def test_seeds_cost_what_they_cost_at_their_own_duration():
    solves = [
        *(
            solved("a", 1.0, 4, days=0.5, cpu_seconds=3600.0),
            solved("b", 1.0, 4, days=1.0, cpu_seconds=7200.0),
        ),
        seeded("c", "a", 4, 8, source="S(1)", k=1, days=0.5, cpu_seconds=0.0),
        seeded("d", "b", 4, 8, source="S(1)", k=1, days=1.0, cpu_seconds=0.0),
    ]
    costs = {
        one.duration_days: one.full_hours.value for one in seed_chains(findings_of(campaign(*solves)))[2:]
    }
    assert costs == pytest.approx({0.5: 1.0, 1.0: 2.0}, rel=1e-14)  # rounding


def test_a_search_continued_in_duration_lives_on_itself_until_it_begins():
    solves = [
        solved("a", 1.0, 4, days=0.5, search="grow", cpu_seconds=3600.0),
        seeded("b", "a", 4, source="grow", k=1, days=1.0, search="grow", cpu_seconds=3600.0),
    ]
    first, second = seed_chains(findings_of(campaign(*solves)))
    assert first.chain == "S(1)" and second.chain == "S(1|1) <- S(1)"
    assert second.full_hours.value == pytest.approx(2.0, rel=1e-14)  # rounding


def test_the_cost_of_seeds_from_elsewhere_is_unknown():
    (one,) = seed_chains(findings_of(campaign(seeded("b", "z", 4, source="imported", k=0))))
    assert one.chain == "S(1|0) <- ?"
    assert isnan(one.ratio.value) and isnan(one.full_hours.value)


def test_a_search_that_would_seed_itself_ends_in_the_unknown():
    (one,) = seed_chains(findings_of(campaign(seeded("a", "a", 4, source="me", k=1, search="me"))))
    assert one.chain.endswith("<- ?") and isnan(one.full_hours.value)


def test_groups_of_several_searches_are_refused():
    with pytest.raises(ValueError, match="groups: expected search among the attributes, got strategy"):
        seed_chains(findings_of(campaign()), by=("strategy",))
