"""Recoveries against the P_1 that they are part of, another integrator, and what an outage cannot do."""

import numpy as np
import pytest

from core.nlp import ExitStatus, SolveSettings
from core.nlp.recoveries import recovery
from core.search import solve_recovery
from core.transcription import ReferencePath, transcribe
from core.verification.verify import verify
from tests.core.known import optimum
from tests.core.partials import assert_partials
from tests.core.rounding import apart
from tests.core.search.seeds import ONE, robust_solution
from tests.core.transcription.points import PRESET, TIGHT, problem, random_point

SETTINGS = SolveSettings(max_iterations=800)
#: Propellant by which two local optima of one recovery may differ [kg]: IPOPT stops at 1e-9 of its objective.
NOISE_KG = 0.05


def recovered(segment, days, seed=None):
    asked = problem(((segment, days),))
    return asked, solve_recovery(*(seed or (PRESET, optimum())), asked, settings=SETTINGS)


def as_recovery(segment, days, n_legs=1):
    """Return P_1, a point of it, and the recovery of its realization with the same point."""
    whole = transcribe(problem(((segment, days),)), n_legs, TIGHT)
    x, own = random_point(whole, 8), whole.layout.trajectories[1]
    part = recovery(whole, ReferencePath(whole, x), own)
    mine = x[own.offset : own.stop].copy()
    mine[1] += days
    return whole, x, part, mine


@pytest.mark.parametrize("segment", [4, 26, 40])  # before, on and behind the matchpoint
def test_a_recovery_has_the_defects_of_its_realization(segment):
    whole, x, part, mine = as_recovery(segment, 1.5)
    # The reference is flown in other steps on the way to its outage.
    difference = np.abs(part.defects(mine) - whole.defects(x)[7:])
    assert np.all(difference <= apart(whole, x, TIGHT)[7:])


def test_a_recovery_has_the_partials_of_its_realization():
    whole, x, part, mine = as_recovery(40, 1.5)
    own = whole.layout.trajectories[1]
    found, expected = part.jacobian(mine).toarray(), whole.jacobian(x).toarray()[7:, own.offset : own.stop]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-6)  # rounding, over a flight
    assert_partials(
        found[:, :3], lambda t: part.defects([*t, *mine[3:]]), mine[:3], step=1e-4, rtol=1e-5, atol=1e-2
    )


def test_the_reference_is_flown_as_it_is_and_another_integrator_agrees():
    asked, outcome = recovered(24, 1.0)
    assert outcome.is_feasible
    np.testing.assert_array_equal(outcome.x[:154], optimum())
    assert outcome.objective == optimum()[153]
    found = verify(asked, outcome.x)
    assert found.strict and found.final_mass_kg[1] == outcome.x[-1]


def test_costs_start_from_nothing_and_rise_with_the_duration():
    # In the last segment of a burn, which an outage misses: each duration costs kilograms more than the one
    # before it.  In a coast the costs are those of neighbouring local optima, tenths of a kilogram apart.
    seed, costs = None, []
    for days in (1e-6, 2.0, 6.0):
        seed = recovered(10, days, seed)
        assert seed[1].is_feasible
        costs.append(optimum()[153] - seed[1].x[-1])
        seed = seed[0], seed[1].x
    assert costs[0] <= NOISE_KG
    assert np.all(np.diff(costs) >= 1.0)


def test_it_is_no_dearer_than_the_realization_of_p_1_on_the_same_reference():
    # P_1 maximizes the mass of its reference; that of the realization is only one that is feasible.
    x = robust_solution()
    outcome = solve_recovery(PRESET, x[:154], ONE, settings=SETTINGS)
    assert outcome.is_feasible and outcome.x[-1] >= x[-1] - NOISE_KG


def test_outages_of_one_problem_are_recovered_from_one_by_one():
    first, second = (recovered(segment, 1.0)[1] for segment in (24, 30))
    both = problem(((24, 1.0), (30, 1.0)))
    outcome = solve_recovery(PRESET, optimum(), both, settings=SETTINGS)
    expected = np.concatenate([optimum(), first.x[154:], second.x[154:]])
    np.testing.assert_array_equal(outcome.x, expected)


def test_a_recovery_can_be_stopped():
    outcome = solve_recovery(PRESET, optimum(), problem(((24, 3.0),)), stop=lambda: True)
    assert outcome.status is ExitStatus.STOPPED and outcome.n_iterations <= 1
