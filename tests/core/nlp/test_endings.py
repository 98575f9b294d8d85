"""Endings that a real solve reaches seldom."""

import numpy as np
import pytest

from core.nlp import ExitStatus, Limits, SolveSettings, never
from core.nlp.ipopt import PATIENCE, _Callbacks
from core.nlp.solve import _close, _weighed
from core.problem import load_problem
from core.transcription import transcribe


@pytest.fixture
def callbacks():
    limits = Limits(cpu_budget=60.0, iteration_budget=10_000, stop=never)
    return _Callbacks(transcribe(load_problem("ppe-drm3")), 0.1, limits, stop_when_closed=False)


def test_a_run_settles_when_closed_points_stop_getting_better(callbacks):
    callbacks._keep(np.full(400, 0.8))
    callbacks.limits.iterations = PATIENCE - 1
    assert not callbacks.is_settled
    callbacks.limits.iterations = PATIENCE
    assert callbacks.is_settled


def test_a_gain_of_more_than_a_gram_starts_the_patience_again(callbacks):
    callbacks._keep(np.full(400, 0.8))
    callbacks.limits.iterations = 100
    callbacks._keep(np.full(400, 0.8001))
    callbacks.limits.iterations = PATIENCE
    assert not callbacks.is_settled


def test_a_feasible_point_at_the_deadline_is_told_from_one_at_the_iteration_limit():
    assert _weighed(ExitStatus.TIMEOUT, True) is ExitStatus.FEASIBLE_AT_DEADLINE
    assert _weighed(ExitStatus.ITERATION_LIMIT, True) is ExitStatus.FEASIBLE_AT_LIMIT
    assert _weighed(ExitStatus.OPTIMAL, False) is ExitStatus.STALLED


def test_partials_that_are_not_finite_leave_the_point_as_it_is(monkeypatch):
    transcription = transcribe(load_problem("ppe-drm3"))
    x = np.mean(transcription.bounds, axis=0)
    nothing = transcription.jacobian(x) * np.nan
    monkeypatch.setattr(type(transcription), "jacobian", lambda self, x: nothing)
    kept, _ = _close(transcription, x, np.full((1, 7), 1e-3))
    np.testing.assert_array_equal(kept, x)


@pytest.mark.parametrize("wrong", [{"max_iterations": 1.5}, {"max_iterations": "x"}, {"cpu_seconds": "a"}])
def test_limits_that_are_no_numbers_are_refused(wrong):
    with pytest.raises(ValueError, match="expected"):
        SolveSettings(**wrong)
