"""Seeds become solutions of problems with outages; another integrator says so."""

from itertools import pairwise

import numpy as np
import pytest

from core.nlp import ExitStatus, SolveSettings
from core.nlp.robust import FIRST_STEP, GROW, SHRINK
from core.search import MAPPINGS, recovery, solve_seed
from core.verification.verify import verify
from tests.core.known import solution
from tests.core.search.seeds import ONE, robust_solution
from tests.core.transcription.points import PRESET, problem

SETTINGS = SolveSettings(max_iterations=400)


def solved(segment, mapping, **options):
    asked = problem(((segment, 1.0),))
    return asked, solve_seed(PRESET, solution(), asked, mapping, SETTINGS, **options)


@pytest.mark.parametrize(
    ("mapping", "segments"),
    # The seed thrusts in 8, 30, 12 and coasts in 40; paths differ between processors, so one of them will do.
    [("aligned", (8, 30, 12)), ("aligned", (40,)), ("continued", (36, 41, 40))],
)
def test_a_seed_survives_an_outage_of_a_day(mapping, segments):
    tried = (solved(segment, mapping) for segment in segments)
    asked, outcome = next((asked, outcome) for asked, outcome in tried if outcome.is_feasible)
    found = verify(asked, outcome.x)
    assert found.strict
    assert found.final_mass_kg[0] == outcome.objective


@pytest.mark.parametrize("mapping", MAPPINGS)
def test_a_seed_chain_can_be_stopped(mapping):
    asked = []

    def stop():
        asked.append(True)
        return len(asked) > 4

    _, outcome = solved(8, mapping, stop=stop)
    assert outcome.status is ExitStatus.STOPPED and outcome.n_iterations <= 6


@pytest.mark.parametrize("mapping", MAPPINGS)
def test_the_iterations_of_all_steps_count_together(mapping):
    asked = problem(((24, 1.0),))
    outcome = solve_seed(PRESET, solution(), asked, mapping, SolveSettings(max_iterations=15))
    assert 0 < outcome.n_iterations <= 2 * 15 + 1  # k + 1 = 2; IPOPT counts the one it is stopped in


@pytest.fixture
def depths(monkeypatch):
    """The depths at which profiles are asked for; the first of a deepening is that of the full outage."""
    noted, profiles = [], recovery.outage_profiles

    def noting(to, seed_problem, x, depth, sources):
        noted.append(depth)
        return profiles(to, seed_problem, x, depth, sources)

    monkeypatch.setattr(recovery, "outage_profiles", noting)
    return noted


def test_a_late_outage_that_no_step_closes_is_deepened_until_it_is_full(depths):
    # The seed thrusts up to its end, so that an outage in its last segment but one leaves it no time.
    asked, outcome = solved(49, "aligned")
    assert outcome.status is ExitStatus.LOCALLY_INFEASIBLE and depths == []
    asked, outcome = solved(49, "continued")
    assert outcome.is_feasible and verify(asked, outcome.x).strict
    assert depths[0] == depths[-1] == 1.0 and 0.0 < min(depths) < 1.0


def is_step(depth, step, trial, after):
    """Return depth and step of the next trial, None if it is none that follows."""
    for start, wider in ((trial, GROW * step), (depth, SHRINK * step)):
        if after == pytest.approx(min(1.0, start + wider), abs=1e-12):  # rounding
            return start, wider
    return None


def test_steps_into_an_outage_grow_after_success_and_shrink_after_failure(depths):
    asked = problem(((49, 3.0),))
    outcome = solve_seed(PRESET, solution(), asked, "continued", SETTINGS)
    assert outcome.is_feasible and verify(asked, outcome.x).strict
    trials = depths[1:]  # profiles of the full outage come first, then each step
    assert len(trials) > 3 and trials[0] == FIRST_STEP and trials[-1] == 1.0
    stand = 0.0, FIRST_STEP
    for trial, after in pairwise(trials):
        stand = is_step(*stand, trial, after)
        assert stand is not None


def test_the_same_seed_gives_the_same_solution_to_the_last_bit():
    first, again = (solved(40, "aligned")[1] for _ in range(2))
    np.testing.assert_array_equal(first.x, again.x)


def test_a_realization_of_the_seed_becomes_that_of_an_outage_nearby():
    asked = problem(((24, 1.0), (28, 1.0)))
    outcome = solve_seed(ONE, robust_solution(), asked, "aligned(1,1)", SETTINGS)
    assert outcome.is_feasible and verify(asked, outcome.x).strict


def test_an_outage_of_half_a_day_becomes_one_of_a_day():
    half, whole = problem(((24, 0.5),)), problem(((24, 1.0),))
    seed = solve_seed(PRESET, solution(), half, "aligned", SETTINGS)
    outcome = solve_seed(half, seed.x, whole, "aligned", SETTINGS)
    assert outcome.is_feasible and verify(whole, outcome.x).strict
