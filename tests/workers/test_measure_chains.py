"""Seeds, cases and mappings are combined each with each; solutions of one case feed the next."""

import itertools
from dataclasses import replace

import pytest

from core.nlp import SolveSettings
from tests.acceptance.known import VECTORS
from tests.workers.fake import record, run_broken
from tests.workers.jobs import PROBLEM
from workers.executor import Inline
from workers.measure_chains import (
    ChainPlan,
    as_fields,
    by_case,
    by_group,
    n_links,
    row,
    solution_of_link,
    solve_links,
    warm_up_links,
)
from workers.measure_solves import (
    DEFAULT_GROUPS,
    GROUPS,
    Case,
    Measurement,
    Solution,
    group_cases,
    in_order,
    parse_cases,
)
from workers.messages import Ending, JobOutcome, MapJob
from workers.run import run_job

SEEDS = tuple(
    Solution(number, PROBLEM, tuple(x), 13276.044404730972 - x[-1], False)
    for number, x in zip((4, 9), VECTORS["S(0)"], strict=True)
)
CASES = tuple(parse_cases("S(3|2)@4-12-20,S(2|0)@4-12,S(1|0)@24,S(2|0)@12-20"))
PLAN = ChainPlan(SEEDS, CASES, ("continued", "reference"), limits=SolveSettings(60.0, 2))


def run_unless_referred(job, stop=lambda: False):
    """Answer strict, a kilogram above the seed; never by the mapping `reference`, never on (4, 12)."""
    segments = [outage["segment"] for outage in job.problem["outages"]]
    is_solved = job.mapping != "reference" and segments != [4, 12]
    solve = record(job, 0, 1.0 if is_solved else -1.0)
    if is_solved:
        strict = solve.certificate.model_copy(update={"strict": True})
        mass = job.seed_x[153] - 1.0
        x = (*solve.x[:153], mass, *solve.x[154:])
        solve = solve.model_copy(update={"certificate": strict, "objective_kg": mass, "x": x})
    return JobOutcome(ending=Ending.FEASIBLE, solves=(solve,))


@pytest.fixture(scope="module")
def solved():
    return list(solve_links(Inline(run_unless_referred), PLAN))


def test_the_groups_are_the_cases_of_the_paper():
    # Tables of P_1, P_2 and P_3 in arXiv 2501.06694; the 12 and the 49 outages are ours.
    assert [case.segments[0] for case in GROUPS["s1"]] == [4, 8, 12, 16, 20, 24, 26, 32, 40, 48]
    assert sum(GROUPS["s2"][0].segments) == 52 and len(GROUPS["s2"]) == len(GROUPS["s3"]) == 6
    assert [case.name for case in GROUPS["s12"]] == ["S(12|0)@4-8-12-16-20-24-28-32-36-40-44-48"]
    assert [case.k for case in GROUPS["s49"]] == [49] and "s49" not in DEFAULT_GROUPS
    assert all(PROBLEM.n_segments > max(case.segments) for group in GROUPS.values() for case in group)


def test_cases_with_seeds_from_others_bring_them_along():
    for target in (case for case in GROUPS["s3from2"] if case.k_from == 2):
        assert any(target.is_fed_by(case) for case in GROUPS["s3from2"])
    kept = in_order(group_cases("s3from2,s2"))
    assert len(kept) == len(set(kept)) == 12
    assert [case.k_from for case in kept] == sorted(case.k_from for case in kept)


def test_a_case_is_read_as_it_is_written():
    for name in ("S(1|0)@24", "S(3|0)@12-24-40", "S(3|2)@4-24-48"):
        (case,) = parse_cases(name)
        assert case.name == name
    assert parse_cases("S(3|2)@48-4-24 , S(1|0)@8") == [Case(2, (4, 24, 48)), Case(0, (8,))]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("24", r"case: expected one like S\(3\|0\)@12-24-40, got '24'"),
        ("S(2|0)@24", r"case S\(2\|0\)@24: expected 2 different segments, got 1: 24"),
        ("S(2|0)@24-24", r"expected 2 different segments, got 2: 24-24"),
        ("S(1|1)@24", r"expected seeds with fewer than 1 outages, got 1"),
    ],
)
def test_a_case_that_cannot_be_is_named(text, message):
    with pytest.raises(ValueError, match=message):
        parse_cases(text)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seeds": ()}, "seeds: expected at least one solution of P_0, got none"),
        ({"seeds": (SEEDS[0], SEEDS[0])}, "seeds: expected different numbers, got one twice"),
        ({"mappings": ("best",)}, "mapping: expected one of reference, .*, got 'best'"),
        ({"cases": (Case(2, (4, 8, 12)),)}, r"case S\(3\|2\)@4-8-12: expected a case with 2 .*, got none"),
        ({"cases": (Case(0, (50,)),)}, "outages: expected a segment in 1..49"),
        ({"duration_days": -1.0}, "duration_days"),
    ],
)
def test_a_plan_that_cannot_be_run_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(PLAN, **changes)


def test_a_group_that_is_not_there_is_named():
    with pytest.raises(ValueError, match=r"group: expected one of s1, s2, .*, got 's7'"):
        group_cases("s1,s7")


def test_every_seed_meets_every_case_and_mapping_and_the_seeds_take_turns(solved):
    first = [one for one in solved if one.link.case.k_from == 0]
    met = [(one.link.seed.number, one.link.case.name, one.link.mapping) for one in first]
    cases = ("S(2|0)@4-12", "S(1|0)@24", "S(2|0)@12-20")
    assert met == list(itertools.product((4, 9), cases, ("continued", "reference")))


def test_a_case_is_fed_by_the_solutions_found_for_its_outages(solved):
    last = [one for one in solved if one.link.case.k_from == 2]
    # (4, 12) is never solved, (12, 20) by one mapping: one seed per solution of P_0, by two mappings.
    assert [(one.link.seed.number, one.link.mapping) for one in last] == list(
        itertools.product((4, 9), ("continued", "reference"))
    )
    for one in last:
        assert one.link.seed_case == Case(0, (12, 20)) and one.link.seed.problem.k == 2
    assert n_links(PLAN) == 2 * 2 * (3 + 2) >= len(solved)


def test_prices_are_counted_from_the_seed_that_was_mapped(solved):
    changes = {one.link.case.name: one.change_kg for one in solved if one.measurement.strict}
    # The runner spends one kilogram at each mapping: the second does not see that of the first.
    assert set(changes) == {"S(1|0)@24", "S(2|0)@12-20", "S(3|2)@4-12-20"}
    assert list(changes.values()) == pytest.approx([1.0] * 3, abs=1e-6)  # kg, rounding of masses
    assert all(one.change_kg is None for one in solved if not one.measurement.strict)


def test_rows_tell_shares_costs_and_failures_of_a_case_and_of_a_group(solved):
    rows = {(one["case"], one["mapping"]): one for one in by_case(PLAN, solved)}
    assert len(rows) == 8 and rows["S(1|0)@24", "continued"]["strict"]["n"] == 2
    assert rows["S(2|0)@4-12", "continued"]["failed_by"] == {"STALLED": 2}
    groups = {(one["group"], one["mapping"]): one for one in by_group(PLAN, solved)}
    two = groups["S(2|0)", "continued"]
    assert (two["strict"]["n"], two["strict"]["of"], two["least_share_of_a_case"]) == (2, 4, 0.0)
    assert two["costs"]["cpu_seconds_per_strict"] == 3.0  # four solves of 1.5 s for two solutions
    assert row([])["strict"]["value"] is None


def test_a_mapped_seed_is_told_in_plain_data(solved):
    told = as_fields(solved[-2])
    assert told["case"] == "S(3|2)@4-12-20" and told["seed"] == 9 and told["seed_case"] == "S(2|0)@12-20"
    assert told["strict"] is True and set(told) > {field for field in Measurement.__slots__}


def test_a_solution_can_be_a_seed_again(solved):
    one = next(one for one in solved if one.measurement.strict)
    found = solution_of_link(PLAN, one)
    assert found.number == 4 and found.problem == PLAN.problem(one.link.case) and found.x == one.x


def test_jobs_that_break_are_failures_of_their_case():
    broken = list(solve_links(Inline(run_broken), replace(PLAN, cases=CASES[2:3])))
    assert [one.measurement.failure for one in broken] == ["ERROR"] * 4
    assert by_group(replace(PLAN, cases=CASES[2:3]), broken)[0]["faults"] == ["ZeroDivisionError: oh"]


def test_the_first_jobs_try_every_mapping():
    seen = []

    def run_noting(job, stop):
        assert isinstance(job, MapJob)
        seen.append((job.mapping, job.settings.max_iterations))
        return run_unless_referred(job)

    warm_up_links(Inline(run_noting), PLAN)
    assert seen == [("continued", 12), ("reference", 12)]


def test_a_real_seed_is_mapped_and_solved_as_far_as_its_limits_let_it():
    plan = replace(PLAN, seeds=SEEDS[1:], cases=CASES[2:3], mappings=("aligned", "reference"))
    ended = {one.link.mapping: one for one in solve_links(Inline(run_job), plan)}
    assert set(ended) == {"aligned", "reference"}
    for one in ended.values():
        assert one.measurement.fault == "" and one.measurement.n_evaluations > 0
    assert ended["reference"].measurement.failure == "ITERATION_LIMIT"
