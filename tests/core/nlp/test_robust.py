"""P_k from a reference: realizations that cost nothing, and those for which the reference moves."""

from dataclasses import replace

import numpy as np
import pytest

from core.analysis.stationarity import stationarity
from core.nlp import ExitStatus, Limits, SolveSettings, no_stop, solve
from core.nlp.robust import Robust
from core.search import solve_recovery, solve_seed
from core.search.mapping import outage_profiles
from core.transcription import transcribe
from core.verification.verify import verify
from tests.core.known import optimum
from tests.core.transcription.points import PRESET, problem

SETTINGS = SolveSettings(max_iterations=600, cpu_seconds=120.0)
CHEAP = replace(SETTINGS, recoveries="cheapest")
#: What the polish that every seed is given may change [kg]: 1e-9 of 15 t, its tolerance, and a gram for
#: defects that are closed better.
POLISH_KG = 2e-3


@pytest.fixture(scope="module")
def reference():
    """An optimum of P_0: it thrusts in 1 to 9, 18 to 21 and 48 to 50, and coasts elsewhere."""
    return solve(transcribe(PRESET), optimum())


def outages(*segments):
    return tuple((segment, 1.0) for segment in segments)


def from_reference(reference, *segments, mapping="aligned", **options):
    asked = problem(outages(*segments))
    return asked, solve_seed(PRESET, reference.x, asked, mapping, SETTINGS, **options)


def assert_robust(asked, outcome):
    """Fail unless another integrator agrees with all trajectories, and the reference is an optimum."""
    found = verify(asked, outcome.x)
    assert outcome.status is ExitStatus.OPTIMAL and outcome.is_feasible
    assert found.strict and found.is_within_bounds
    assert found.defects.shape == (1 + asked.k, 7)
    assert stationarity(transcribe(asked), outcome.x).is_optimal


@pytest.mark.parametrize("segments", [(40,), (8,), (12, 24, 40)])
def test_outages_that_can_be_made_up_for_cost_nothing(reference, segments):
    asked, outcome = from_reference(reference, *segments)
    assert_robust(asked, outcome)
    # Nothing of the reference had to move, up to the polish.
    assert outcome.objective == pytest.approx(reference.objective, abs=POLISH_KG)


def test_a_late_outage_makes_the_reference_move(reference):
    # In the first segment of the insertion burn, of four days: too little time is left to make up for it.
    asked, outcome = from_reference(reference, 48)
    assert_robust(asked, outcome)
    assert 0.01 < abs(outcome.objective - reference.objective) < 20.0
    assert np.abs(outcome.x[:3] - reference.x[:3])[:2].max() > 1e-3


def test_an_outage_that_costs_nothing_joins_one_that_does(reference):
    asked, both = from_reference(reference, 24, 48)
    assert_robust(asked, both)


def test_a_uniform_guess_of_p1_has_an_outcome_whose_reference_is_closed(reference):
    asked = problem(outages(24))
    flown = transcribe(asked)
    lower, upper = flown.bounds
    x = np.concatenate([reference.x, np.random.default_rng(1).random(flown.n_variables - 154)])
    x[154:] = (lower + (upper - lower) * np.concatenate([np.zeros(154), x[154:]]))[154:]
    outcome = solve(flown, x, SETTINGS)
    assert_robust(asked, outcome)
    assert outcome.objective == pytest.approx(reference.objective, abs=POLISH_KG)


def test_seeds_of_p1_become_p2_with_the_known_outage_still_survived(reference):
    one, seed = from_reference(reference, 24)
    two = problem(outages(24, 40))
    outcome = solve_seed(one, seed.x, two, "aligned", SETTINGS)
    assert_robust(two, outcome)
    own = transcribe(one).layout.trajectories[1]
    # Closed anew against the same reference, the known realization needs no step: times and masses agree.
    for place in (own.shooting_time, own.initial_coast, own.final_coast, own.final_mass):
        assert outcome.x[place] == pytest.approx(seed.x[place], abs=1e-4)
    assert outcome.objective == pytest.approx(seed.objective, abs=POLISH_KG)


@pytest.mark.parametrize("segments", [(24,), (10, 48)])
def test_each_recovery_is_the_cheapest_found_and_leaves_the_reference_to_the_last_bit(reference, segments):
    asked = problem(outages(*segments))
    any_of_them, cheapest = (
        solve_seed(PRESET, reference.x, asked, "aligned", settings) for settings in (SETTINGS, CHEAP)
    )
    assert verify(asked, cheapest.x).strict and cheapest.n_iterations > any_of_them.n_iterations
    own, *others = transcribe(asked).layout.trajectories
    np.testing.assert_array_equal(cheapest.x[: own.stop], any_of_them.x[: own.stop])
    alone = solve_recovery(PRESET, cheapest.x[: own.stop], asked, settings=SETTINGS)
    for one in others:
        assert cheapest.x[one.final_mass] >= any_of_them.x[one.final_mass]
        # IPOPT stops at 1e-9 of its objective, and the optima of a recovery that starts elsewhere differ.
        assert cheapest.x[one.final_mass] >= alone.x[one.final_mass] - 0.05


def test_the_same_seed_gives_the_same_solution_to_the_last_bit(reference):
    first, again = (from_reference(reference, 48)[1] for _ in range(2))
    np.testing.assert_array_equal(first.x, again.x)
    assert first.n_iterations == again.n_iterations


@pytest.mark.parametrize("most", [1, 15, 60])
def test_the_iterations_of_all_phases_count_together(reference, most):
    asked = problem(outages(24, 48))
    settings = SolveSettings(max_iterations=most)
    outcome = solve_seed(PRESET, reference.x, asked, "continued", settings)
    # Three trajectories; IPOPT counts the iteration that it is stopped in.
    assert 0 < outcome.n_iterations <= 3 * most + 1


@pytest.mark.parametrize("after", [4, 30, 60])
def test_a_stop_ends_all_phases(reference, after):
    asked = []

    def stop():
        asked.append(True)
        return len(asked) > after

    _, outcome = from_reference(reference, 24, 48, mapping="continued", stop=stop)
    assert outcome.status is ExitStatus.STOPPED and outcome.n_iterations <= after + 1


class Depths:
    """What is flown during outages, as a mapping gives it; depths at which it was asked are kept."""

    def __init__(self, seed):
        self.seed, self.asked = seed, []

    def __call__(self, asked, depth):
        self.asked.append(depth)
        return outage_profiles(asked, PRESET, self.seed, depth)


def taken_apart(reference, segment, limits):
    """Return a problem taken apart, its realization continuing as the reference does."""
    deepen = Depths(reference.x)
    asked = problem(outages(segment))
    flown = transcribe(asked)
    seeded = solve_seed(PRESET, reference.x, asked, "aligned", SolveSettings(max_iterations=1))
    robust = Robust(flown, limits, deepen, reference.x, [seeded.x[154:]], None, [None])
    return robust, deepen


def test_deepening_ends_with_the_budget_and_takes_nothing(reference):
    limits = Limits(60.0, 5, no_stop, iterations=5)
    robust, deepen = taken_apart(reference, 48, limits)
    before = robust.x.copy()
    assert not robust.close_together([0])
    assert limits.iterations == 5 and len(deepen.asked) <= 1
    np.testing.assert_array_equal(robust.x, before)
