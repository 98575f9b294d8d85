"""A seed cut finer flies as before, says the verifier; what the solver then gains is real."""

import numpy as np
import pytest

from core.nlp import SolveSettings
from core.search import REFINED, expand_mapping, map_seed, refined_problem, solve_seed
from core.transcription import layout_of, transcribe
from core.verification.certificate import certify
from core.verification.verify import verify
from tests.core.known import solution
from tests.core.search.seeds import ONE, robust_solution
from tests.core.transcription.points import PRESET, problem


def test_a_robust_seed_cut_finer_flies_the_same_states_at_the_same_times():
    finer = refined_problem(ONE, 100)
    guess = map_seed(ONE, robust_solution(), finer, REFINED)
    before, after = (certify(*pair) for pair in ((ONE, robust_solution()), (finer, guess.x)))
    for old, new in zip(before.trajectories, after.trajectories, strict=True):
        # The recovery coasts for ten days first, which hold the unlit segments that are added.
        first = len(new.through.states) - 1 - 2 * (len(old.through.states) - 1)
        states = new.through.states[first::2]
        # Steps end elsewhere, so RTOL = 1e-13 a step, amplified by a passage of the Moon.
        assert states[:, :3] == pytest.approx(old.through.states[:, :3], abs=0.05)
        assert states[:, 6] == pytest.approx(old.through.states[:, 6], abs=1e-9)
        assert new.mass.arrival == pytest.approx(old.mass.arrival, abs=1e-9)
    assert after.level == "strict"
    assert np.allclose(after.verification.position_km, before.verification.position_km, atol=0.05)


def test_unlit_segments_on_the_target_change_no_defect():
    finer, seed = refined_problem(ONE, 100), robust_solution()
    # Half a segment of the recovery lasts 0.8 days, for which this coast has no room; nor is it closed now.
    seed[layout_of(ONE).trajectories[1].initial_coast] = 0.1
    guess = map_seed(ONE, seed, finer, REFINED)
    before = transcribe(ONE, tolerance=1e-12).defects(seed)
    after = transcribe(finer, tolerance=1e-12).defects(guess.x)
    assert np.abs(before).max() > 1e3
    assert after == pytest.approx(before, abs=0.05)  # 1e-12 a step, amplified by the passages of the Moon


def test_the_outage_begins_at_the_same_time_and_lasts_as_long():
    finer = refined_problem(ONE, 200)
    (outage,) = finer.outages
    assert (outage.segment, outage.duration_days) == (93, 1.0)
    assert (outage.segment - 1) / 200 == (ONE.outages[0].segment - 1) / 50


def test_a_guess_cut_finer_lies_within_the_bounds_of_its_problem():
    finer = refined_problem(ONE, 100)
    guess = map_seed(ONE, robust_solution(), finer, REFINED)
    lower, upper = layout_of(finer).bounds(finer, 13276.0447)
    assert np.all(guess.x >= lower - 1e-9) and np.all(guess.x <= upper + 1e-9)


def test_extra_segments_lie_in_the_initial_coast_only_as_far_as_it_is_long_enough():
    finer, seed = refined_problem(ONE, 100), robust_solution()
    old, new = (layout_of(one).trajectories[1] for one in (ONE, finer))
    half = seed[old.shooting_time] / old.n_segments / 2
    for coast, is_before in ((half * 1.01, True), (half * 0.99, False)):
        seed[old.initial_coast] = coast
        x = map_seed(ONE, seed, finer, REFINED).x
        throttles = x[new.controls][::3]
        assert (throttles[0] == 0.0) == is_before and (throttles[-1] == 0.0) != is_before
        end = seed[old.shooting_time] + seed[old.initial_coast] + seed[old.final_coast]
        assert x[new.shooting_time] + x[new.initial_coast] + x[new.final_coast] == pytest.approx(
            end, abs=1e-12
        )


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (PRESET, "multiple of 50 and more than that, got 50"),
        (
            refined_problem(PRESET, 100).model_copy(update={"segmentation": "uniform"}),
            "number of segments alone",
        ),
        (problem(((24, 1.0),)), "multiple of 50 and more than that, got 50"),
        (refined_problem(ONE, 100), "number of segments alone"),
    ],
)
def test_what_is_no_finer_cut_of_the_same_problem_is_refused(other, message):
    with pytest.raises(ValueError, match=message):
        expand_mapping(REFINED, PRESET, other)


def test_more_segments_save_propellant_from_the_seed_on():
    finer = refined_problem(PRESET, 100)
    outcome = solve_seed(PRESET, solution(), finer, REFINED, SolveSettings(max_iterations=150))
    found = verify(finer, outcome.x)
    # The seed itself is a point of the finer problem, so its optimum leaves no less mass.
    assert found.strict and outcome.objective > solution()[153] - 1e-3
