"""Groups of solves: counts and costs against the paper's table and by hand."""

import json
from math import isnan

import pytest

from core.analysis.campaign_statistics import (
    case_name,
    cost_of,
    count_distinct,
    findings_of,
    group_solves,
    row,
    seed_yields,
    summaries,
    summarize,
)
from tests.core.analysis.solves import campaign, failed, solved


def made(*solves, **arguments):
    return findings_of(campaign(*solves, **arguments))


@pytest.mark.parametrize(
    ("segments", "n_solutions", "n_guesses", "hours"),
    [
        # Table 8 of the paper: solutions and hours per solution, with the guesses that it implies.
        ((), 233, 2400, 5.15),
        ((4,), 1053, 12000, 11.40),
        ((4, 48), 161, 4800, 44.72),
        ((4, 24, 48), 3, 3600, 2400.0),
    ],
)
def test_hours_per_solution_at_the_papers_charge_are_those_of_its_table(
    segments, n_solutions, n_guesses, hours
):
    found = [solved("a", 300.0, *segments)] * n_solutions
    solves = found + [failed(segments)] * (n_guesses - n_solutions)
    summary = summarize(made(*solves), solves)
    assert summary.cost_per_paper.charged_hours == pytest.approx(hours, abs=0.005)  # printed digits


def test_costs_count_failures_and_the_time_spent_or_allowed():
    solves = [
        solved("a", cpu_seconds=1800.0, cap_seconds=3600.0),
        failed(cpu_seconds=5400.0, cap_seconds=7200.0),
    ]
    summary = summarize(made(*solves), solves)
    assert summary.cost == summary.cost_per_strict == (2.0, 3.0, 1.0)
    assert summary.distinct_per_core_hour == 0.5


def test_ratios_and_costs_are_told_at_both_tolerances():
    solves = [solved("a"), solved("b", is_strict=False), failed(), failed()]
    summary = summarize(made(*solves), solves)
    assert (summary.n_solves, summary.n_paper, summary.n_strict) == (4, 2, 1)
    assert (summary.paper_ratio.value, summary.strict_ratio.value) == (0.5, 0.25)
    assert summary.cost_per_strict.core_hours == 2 * summary.cost_per_paper.core_hours


def test_propellant_and_delta_v_are_those_of_solutions_at_the_level_asked_for():
    solves = [solved("a", 200.0), solved("b", 400.0), solved("c", 900.0, is_strict=False), failed()]
    findings = made(*solves)
    strict, paper = (summarize(findings, solves, level) for level in ("strict", "paper"))
    assert (strict.propellant_kg.n, strict.propellant_kg.mean, strict.propellant_kg.least) == (
        2,
        300.0,
        200.0,
    )
    assert (paper.propellant_kg.n, paper.propellant_kg.median) == (3, 400.0)
    assert strict.delta_v_km_s.mean == pytest.approx(0.6, rel=1e-15)  # 300 kg of 500 a km/s; rounding
    assert strict.delta_v_total_km_s.mean == pytest.approx(3.6, rel=1e-15)  # rounding


def test_distinct_solutions_are_counted_within_each_case():
    # 4.4 d of 90 d are less than the threshold of 0.05, and 8.8 d more.
    days = {"a": 40.0, "b": 44.4, "c": 48.8, "d": 40.0}
    solves = [solved("a", 1.0, 4), solved("b", 1.0, 4), solved("c", 1.0, 4), solved("d", 1.0, 8)]
    findings = made(*solves, shooting_days=days)
    assert count_distinct(findings, solves[:2]) == 1
    assert count_distinct(findings, [solves[1], solves[0], solves[2]]) == 1
    assert count_distinct(findings, solves[:3]) == 2
    assert summarize(findings, solves).n_distinct == 3
    # An outlier first, so that the last solution is not of the last cluster.
    assert count_distinct(findings, [solves[2], solves[0], solves[2]]) == 2


def test_a_solution_found_twice_is_one():
    solves = [solved("a"), solved("a")]
    assert summarize(made(*solves), solves).n_distinct == 1


def test_groups_keep_the_order_of_the_solves_and_split_strategies_and_durations():
    solves = [failed((8,), 1.5), failed(), failed((4,), 0.5), failed((4,), 1.5), failed((8, 12), 0.5)]
    groups = group_solves(solves)
    assert list(groups) == [("S(1)", 1.5), ("S(0)", 0.0), ("S(1)", 0.5), ("S(2)", 0.5)]
    assert groups["S(1)", 1.5] == [solves[0], solves[3]]


def test_a_summary_names_what_its_solves_share():
    solves = [failed((4, 48), 0.5), failed((4, 12), 0.5)]
    whole, *cases = summaries(made(*solves)) + summaries(made(*solves), by=("outages",))
    assert (whole.strategy, whole.duration_days, whole.case, whole.n_cases) == ("S(2)", 0.5, None, 2)
    assert [case.case for case in cases] == ["4-48", "4-12"]


def test_a_case_with_outages_of_different_length_names_them():
    assert case_name(((4, 0.5), (48, 1.0))) == "4:0.5d-48:1d"
    assert case_name(()) == ""


def test_an_empty_group_has_no_numbers_but_its_zeros():
    summary = summarize(made(), [])
    assert (summary.n_solves, summary.n_distinct, summary.strategy) == (0, 0, None)
    assert isnan(summary.strict_ratio.value) and isnan(summary.cost_per_strict.core_hours)
    assert isnan(summary.distinct_per_core_hour) and isnan(summary.delta_v_km_s.mean)
    assert summaries(made()) == () and seed_yields([]) == ()


def test_a_row_is_flat_and_holds_none_where_nothing_is_known():
    cells = row(summarize(made(failed()), [failed()]))
    assert (cells["strict_ratio"], cells["strict_ratio_low"]) == (0.0, 0.0)
    assert cells["cost_per_strict_core_hours"] is None and cells["propellant_kg_mean"] is None
    assert cells["propellant_kg_n"] == 0 and cells["strategy"] == "S(0)"
    assert json.dumps(cells, allow_nan=False)


def test_yields_tell_seeds_solves_and_solutions_of_each_pair_in_order():
    from_p1 = {"seeds_from": "S(1)", "seed_k": 1}
    solves = [
        solved("b", 1.0, 4, 8, seed_id="a", cpu_seconds=30.0, **from_p1),
        solved("c", 1.0, 4, 8, seed_id="a", is_strict=False, cpu_seconds=40.0, **from_p1),
        failed((4, 8), seed_id="z", cpu_seconds=50.0, **from_p1),
        failed(),
    ]
    drawn, mapped = seed_yields(solves)
    assert (drawn.seed_k, drawn.k, drawn.n_seeds, drawn.n_solves) == (None, 0, 0, 1)
    assert (mapped.seed_k, mapped.k, mapped.n_seeds, mapped.n_solves) == (1, 2, 2, 3)
    assert (mapped.n_paper, mapped.n_strict, mapped.strict_ratio.value) == (2, 1, 1 / 3)
    assert mapped.core_seconds_per_strict == pytest.approx(120.0, rel=1e-15)  # rounding
    assert cost_of(solves).charged_hours == 0.5 * (3 * 3 + 1)
