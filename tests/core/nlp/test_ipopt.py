"""The problem as IPOPT sees it: partials, cached values, the iterates that are kept."""

import numpy as np
import pytest

from core.nlp import Limits, never
from core.nlp.ipopt import _Callbacks
from tests.core.known import near
from tests.core.partials import assert_partials
from tests.core.transcription.points import transcription


@pytest.fixture
def callbacks():
    flown = transcription(n_legs=10, tolerance=1e-12)
    return _Callbacks(flown, 0.1, Limits(10.0, 100, never), stop_when_closed=False)


def start(callbacks, rng_seed=1):
    return callbacks.transcription.lift(near(callbacks.transcription, rng_seed))


def test_the_objective_is_less_for_more_final_mass(callbacks):
    z = start(callbacks)
    before = callbacks.objective(z)
    z[callbacks.transcription.layout.reference.final_mass] += 0.01
    assert callbacks.objective(z) == pytest.approx(before - 0.001, abs=1e-15)  # weight 0.1; rounding


def test_the_gradient_is_that_of_the_objective(callbacks):
    z = start(callbacks)
    # Linear: rounding eps / h alone.
    assert_partials(callbacks.gradient(z), callbacks.objective, z, step=1e-3, rtol=0, atol=1e-12)


def test_each_point_is_flown_once_however_often_it_is_asked_for(callbacks):
    z = start(callbacks)
    first = callbacks.constraints(z).copy()
    callbacks.constraints(z.copy())
    assert callbacks.limits.evaluations == 1
    callbacks.jacobian(z)
    callbacks.jacobian(z.copy())
    callbacks.constraints(z)
    assert callbacks.limits.evaluations == 2
    # With the partials the sums run in another order.
    np.testing.assert_allclose(callbacks.constraints(z), first, rtol=0, atol=1e-12)


def test_another_point_is_flown_again(callbacks):
    z = start(callbacks)
    before = callbacks.constraints(z).copy()
    z[3] -= 1e-3  # in place, as a solver may change its vector
    after = callbacks.constraints(z)
    assert callbacks.limits.evaluations == 2 and np.any(after != before)
    np.testing.assert_array_equal(
        after, callbacks.transcription.evaluate(callbacks.transcription.lifted, z, False)[0]
    )


def iterate(callbacks, z, defect, alg_mod=0):
    callbacks.jacobian(z)
    return callbacks.intermediate(alg_mod, 1, 0.0, defect, 0.0, 0.1, 0.0, 0.0, 1.0, 1.0, 1)


def test_the_closed_iterate_with_the_most_mass_is_kept(callbacks):
    mass = callbacks.transcription.layout.reference.final_mass
    points = [start(callbacks) for _ in range(4)]
    for z, level in zip(points, (0.84, 0.86, 0.85, 0.9), strict=True):
        z[mass] = level
    for z, defect in zip(points, (1e-9, 1e-9, 1e-9, 1e-3), strict=True):
        assert iterate(callbacks, z, defect)
    assert callbacks.closed[mass] == 0.86


def test_nothing_is_kept_while_the_solver_restores_feasibility(callbacks):
    iterate(callbacks, start(callbacks), 1e-9, alg_mod=1)  # its defects are those of another problem
    assert callbacks.closed is None


def test_a_run_ends_at_its_first_closed_iterate_if_asked_to(callbacks):
    callbacks.stop_when_closed = True
    assert iterate(callbacks, start(callbacks), 1e-3)
    assert not iterate(callbacks, start(callbacks), 1e-9)


def test_a_run_goes_on_until_a_limit_or_the_caller_says_stop(callbacks):
    z = start(callbacks)
    callbacks.limits.iteration_budget = 2
    assert [iterate(callbacks, z, 1.0) for _ in range(2)] == [True, False]
    callbacks.limits = Limits(10.0, 100, stop=lambda: True)
    assert not iterate(callbacks, z, 1.0)
    callbacks.limits = Limits(-1.0, 100, never)
    assert not iterate(callbacks, z, 1.0)
