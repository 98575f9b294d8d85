"""Seeds become solutions of problems with outages; another integrator says so."""

import numpy as np
import pytest

from core.analysis.verify import verify
from core.nlp import ExitStatus, SolveSettings
from core.search import MAPPINGS, continuation, solve_seed
from tests.core.known import solution
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


@pytest.mark.parametrize(
    ("closes", "expected"),
    [
        ([True], [1.0]),  # most outages need no steps at all
        ([False, True, True, True], [1.0, 0.3, 0.9, 1.0]),  # a third of the step, then twice and twice that
        ([False, True, False, True, True, True], [1.0, 0.3, 0.9, 0.48, 0.84, 1.0]),
    ],
)
def test_a_failed_step_into_the_outage_is_shortened_and_a_good_one_lengthened(monkeypatch, closes, expected):
    depths, answers, profiles = [], iter(closes), continuation.outage_profiles

    def noted(to, source, x, depth):
        depths.append(depth)
        return profiles(to, source, x, depth)

    monkeypatch.setattr(continuation, "outage_profiles", noted)
    monkeypatch.setattr(continuation, "close_defects", lambda flown, z, *rest: z if next(answers) else None)
    solve_seed(PRESET, solution(), problem(((8, 1.0),)), "continued", SolveSettings(max_iterations=1))
    assert depths == pytest.approx(expected, abs=1e-15)  # rounding


@pytest.mark.parametrize("mapping", MAPPINGS)
def test_a_seed_chain_can_be_stopped(mapping):
    asked = []

    def stop():
        asked.append(True)
        return len(asked) > 4

    _, outcome = solved(8, mapping, stop=stop)
    assert outcome.status is ExitStatus.STOPPED and outcome.n_iterations <= 6


def test_the_iterations_of_all_steps_count_together(monkeypatch):
    monkeypatch.setattr(continuation, "FIRST_STEP", 0.5)
    asked = problem(((24, 1.0),))
    outcome = solve_seed(PRESET, solution(), asked, "continued", SolveSettings(max_iterations=15))
    assert 0 < outcome.n_iterations <= 2 * 15  # k + 1 = 2


def test_the_same_seed_gives_the_same_solution_to_the_last_bit():
    first, again = (solved(40, "aligned")[1] for _ in range(2))
    np.testing.assert_array_equal(first.x, again.x)
