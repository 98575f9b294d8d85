"""Limits and statuses: what is refused, and what a status means for a closed point and an open one."""

import numpy as np
import pytest

from core.nlp import ExitStatus, Limits, SolveSettings, limits_of, no_stop, outcome_of
from tests.core.known import near, solution
from tests.core.transcription.points import problem, transcription

CLOSED = {
    ExitStatus.OPTIMAL: ExitStatus.OPTIMAL,
    ExitStatus.ACCEPTABLE: ExitStatus.ACCEPTABLE,
    ExitStatus.ITERATION_LIMIT: ExitStatus.FEASIBLE_AT_LIMIT,
    ExitStatus.TIMEOUT: ExitStatus.FEASIBLE_AT_DEADLINE,
    ExitStatus.STOPPED: ExitStatus.STOPPED,
    ExitStatus.LOCALLY_INFEASIBLE: ExitStatus.FEASIBLE_AT_LIMIT,
}


def judged(x, status):
    limits = Limits(60.0, 100, no_stop, iterations=7, evaluations=9)
    return outcome_of(transcription(n_legs=10, tolerance=3e-10), x, status, limits)


@pytest.mark.parametrize("status", CLOSED)
def test_what_is_closed_is_feasible_however_the_solve_ended(status):
    outcome = judged(solution(), status)
    assert outcome.is_feasible and outcome.status is CLOSED[status]
    assert (outcome.n_iterations, outcome.n_evaluations) == (7, 9)


@pytest.mark.parametrize("status", CLOSED)
def test_what_is_open_is_never_called_optimal(status):
    outcome = judged(near(transcription(), 1), status)
    ended_well = status in (ExitStatus.OPTIMAL, ExitStatus.ACCEPTABLE)
    assert not outcome.is_feasible
    assert outcome.status is (ExitStatus.STALLED if ended_well else status)


@pytest.mark.parametrize("k", [0, 2])
def test_both_limits_grow_with_the_number_of_trajectories(k):
    asked = transcription(((12, 1.0), (24, 1.0))[:k])
    limits = limits_of(asked, SolveSettings(cpu_seconds=5.0, max_iterations=70), no_stop)
    assert (limits.cpu_budget, limits.iteration_budget) == (5.0 * (1 + k), 70 * (1 + k))
    assert problem(((12, 1.0), (24, 1.0))[:k]).k == k


def test_a_stop_that_was_asked_for_once_stays_asked_for():
    answers = iter([False, True, False])
    limits = Limits(60.0, 100, lambda: next(answers))
    assert [limits.is_over, limits.is_over, limits.is_over] == [False, True, True]


@pytest.mark.parametrize(
    "settings",
    [
        {"cpu_seconds": 0.0},
        {"cpu_seconds": np.nan},
        {"cpu_seconds": "a"},
        {"max_iterations": 0},
        {"max_iterations": 1.5},
        {"max_iterations": "x"},
    ],
)
def test_limits_under_which_nothing_can_be_solved_are_refused(settings):
    with pytest.raises(ValueError, match=rf"{next(iter(settings))}: expected .*, got"):
        SolveSettings(**settings)


def test_every_status_is_a_sentence_with_advice():
    for status in ExitStatus:
        assert status.value[0].isupper() and status.value.endswith(".")
        assert status.name.startswith(("OPTIMAL", "ACCEPTABLE")) or ";" in status.value
