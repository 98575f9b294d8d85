"""The benchmark counts every guess once, and the same ones for any number of processes."""

import json
from dataclasses import replace

import numpy as np
import pytest

from core.nlp import SolveSettings
from tests.acceptance.known import VECTORS
from tests.workers.fake import run_broken, run_fake
from tests.workers.jobs import PROBLEM
from workers.executor import Inline, ProcessPool
from workers.measure_solves import (
    DISTINCT,
    GuessPlan,
    Solution,
    distance,
    distinct,
    load_seeds,
    measured,
    read_solutions,
    solution_of,
    solve_guesses,
    warm,
    warm_up,
    write_solutions,
)
from workers.messages import Ending, JobOutcome
from workers.run import run_job

X = [tuple(x) for x in VECTORS["S(0)"]]
BRIEF = GuessPlan(PROBLEM, 3, 7, "thrust-coast-thrust", SolveSettings(60.0, 3))


def solution(number, x, **changes):
    return replace(Solution(number, PROBLEM, tuple(x), 200.0 + number, False), **changes)


def test_guesses_that_end_at_a_limit_have_the_same_numbers_on_one_process_and_on_two():
    pool = ProcessPool(2)
    warm_up(pool, BRIEF)
    apart = sorted(solve_guesses(pool, BRIEF), key=lambda one: one.number)
    pool.close()
    together = list(solve_guesses(Inline(run_job), BRIEF))

    def lasting(one):
        return one.number, replace(one.measurement, cpu_seconds=0.0, verify_seconds=0.0)

    assert [lasting(one) for one in apart] == [lasting(one) for one in together]
    assert [one.number for one in apart] == [0, 1, 2]
    assert all(one.measurement.failure == "ITERATION_LIMIT" and one.x is None for one in apart)
    assert len({one.measurement.propellant_kg for one in apart}) == 3


def test_every_guess_is_counted_once_and_strict_ones_keep_their_vector():
    solved = list(solve_guesses(Inline(run_fake), replace(BRIEF, n_guesses=8)))
    assert [one.number for one in solved] == list(range(8))
    assert {one.measurement.strict for one in solved} == {True, False}
    for one in solved:
        assert (one.x is not None) == one.measurement.strict == (one.measurement.failure == "")


def test_a_job_without_a_solve_is_a_failure_that_names_its_fault():
    (one,) = solve_guesses(Inline(run_broken), replace(BRIEF, n_guesses=1))
    assert one.measurement.failure == "ERROR" and one.measurement.fault == "ZeroDivisionError: oh"


def test_a_strict_solution_of_the_preset_is_measured_with_its_distance_from_optimal():
    def run_known(job, stop):
        outcome = run_fake(job.model_copy(update={"rng_seed": 5}), stop)
        known = {"x": X[1], "objective_kg": X[1][-1]}
        solve = outcome.solves[0].model_copy(update=known)
        return JobOutcome(ending=Ending.FEASIBLE, solves=(solve,))

    solved = [one.measurement for one in solve_guesses(Inline(run_known), replace(BRIEF, n_guesses=8))]
    strict = [one for one in solved if one.strict]
    # The descent test of core.analysis.stationarity measures this vector's gradient as worth following.
    assert strict and all(1e-4 < one.stationarity < 1e-2 and not one.is_optimal for one in strict)
    assert strict[0].propellant_kg == pytest.approx(13276.044 - X[1][-1], abs=1e-3)  # kg, the departure mass


def test_a_first_job_runs_on_every_process_with_few_iterations():
    seen = []

    class Pair(Inline):
        def capacity(self):
            return 2

    def run_noting(job, stop):
        seen.append((job.address.chain, job.settings.max_iterations))
        return run_fake(job, stop)

    warm_up(Pair(run_noting), replace(BRIEF, limits=SolveSettings(60.0, 900)))
    assert seen == [(0, 12), (0, 12)]
    warm(Pair(run_noting), [])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"n_guesses": 0}, "guesses: expected at least 1, got 0"),
        ({"law": "gauss"}, "law: expected one of uniform, thrust-coast-thrust, got 'gauss'"),
    ],
)
def test_a_plan_that_cannot_be_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(BRIEF, **changes)


def test_solutions_are_saved_and_read_to_the_bit(tmp_path):
    robust = PROBLEM.with_outages([(24, 1.0)])
    saved = [solution(3, X[0]), solution(8, VECTORS["S(1|0)"][0], problem=robust, is_optimal=True)]
    write_solutions(tmp_path / "seeds.json", PROBLEM, saved)
    assert read_solutions(tmp_path / "seeds.json") == saved


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("{}", "no 'problem'"),
        ("[", "Expecting value"),
        (json.dumps({"problem": {"preset": "moon"}, "solutions": []}), "moon|preset|departure"),
        (None, "No such file"),
    ],
)
def test_a_file_without_seeds_is_named(tmp_path, text, told):
    path = tmp_path / "seeds.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ValueError, match=rf"seeds: expected .*{path}.*({told})"):
        read_solutions(path)


def test_the_distance_of_solutions_sees_thrust_and_times_but_no_angles_of_unlit_segments():
    x = np.zeros(154)
    x[0], x[3::3] = 40.0, 0.0
    for index, value, expected in ((3, 0.5, 0.5 / np.sqrt(50)), (0, 49.0, 0.1), (1, 3.0, 0.1), (2, 9.0, 0.0)):
        other = x.copy()
        other[index] = value
        assert distance(PROBLEM, x, other) == pytest.approx(expected, rel=1e-4)  # widths 90 d and 30 d
    unlit = x.copy()
    unlit[4] = 1.0
    assert distance(PROBLEM, x, unlit) == 0.0


def test_of_solutions_that_hardly_differ_the_first_is_kept():
    near = np.array(X[0])
    near[0] += 0.9 * DISTINCT * 90.0
    far = np.array(X[0])
    far[0] -= 1.1 * DISTINCT * 90.0
    kept = distinct([solution(1, X[0]), solution(2, near), solution(3, far)])
    assert [one.number for one in kept] == [1, 3]


def test_seeds_are_the_first_in_the_order_of_their_guesses_whoever_finishes_first():
    class Backwards(Inline):
        """Runs four jobs at a time, the last one first."""

        def capacity(self):
            return 4

        def finished(self, timeout):
            self._waiting.reverse()
            return super().finished(timeout)

    plan = replace(BRIEF, n_guesses=40)
    seeds = load_seeds(Inline(run_fake), plan, 5)
    assert len(seeds) == 5 and seeds == load_seeds(Backwards(run_fake), plan, 5)
    numbers = [one.number for one in solve_guesses(Inline(run_fake), plan) if one.x is not None]
    assert [seed.number for seed in seeds] == numbers[:5]


def test_too_few_seeds_are_an_error_that_counts_them():
    with pytest.raises(ValueError, match=r"seeds: expected 9 distinct solutions, got \d of 4 guesses"):
        load_seeds(Inline(run_fake), replace(BRIEF, n_guesses=4), 9)


def test_a_solution_keeps_the_number_of_its_guess():
    solved = [one for one in solve_guesses(Inline(run_fake), replace(BRIEF, n_guesses=8)) if one.x]
    found = solution_of(BRIEF, solved[0])
    assert found.number == solved[0].number and found.x == solved[0].x
    assert measured(PROBLEM, JobOutcome(ending=Ending.CRASH))[0].fault == "no solve was recorded"
