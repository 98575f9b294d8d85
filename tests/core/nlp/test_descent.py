import numpy as np
import pytest

from core.nlp.descent import Cost, ThrustVectors
from core.problem import load_problem
from core.search import sample_guess
from core.transcription import Transcription, transcribe


@pytest.fixture(scope="module")
def transcription() -> Transcription:
    return transcribe(load_problem("ppe-drm3"))


def test_a_balanced_start_leaves_only_the_matchpoint_open(transcription: Transcription) -> None:
    form = ThrustVectors(transcription)
    z = form.start(sample_guess(transcription, np.random.default_rng(100)))
    defects = form.defects(z).reshape(-1, 7)
    assert np.abs(defects[:-1]).max() == 0.0
    assert abs(defects[-1, 6]) < 1e-12  # rounding of a sum of fifty masses


def test_partials_by_throttle_vectors_agree_with_differences(transcription: Transcription) -> None:
    form = ThrustVectors(transcription.at_tolerance(1e-13))
    z = form.start(sample_guess(transcription, np.random.default_rng(100)))
    step = 1e-6 * np.random.default_rng(1).standard_normal(len(z))
    _, jacobian = form.linearize(z)
    change = 0.5 * (form.defects(z + step) - form.defects(z - step))
    # Legs of a week amplify the cube of the step and the integrator's 1e-13.
    assert np.abs(change - jacobian @ step).max() < 1e-6 * np.abs(change).max()


def test_a_decision_survives_the_way_through_throttle_vectors(transcription: Transcription) -> None:
    form = ThrustVectors(transcription)
    x = sample_guess(transcription, np.random.default_rng(100))
    again = form.decision(form.start(x))
    last = transcription.layout.reference.final_mass
    assert np.delete(again, last) == pytest.approx(np.delete(x, last), rel=1e-12)


@pytest.mark.parametrize("cost", [Cost(energy=1.0, penalty=100.0), Cost(has_propellant=True, penalty=10.0)])
def test_the_slopes_of_a_cost_agree_with_differences(transcription: Transcription, cost: Cost) -> None:
    form = ThrustVectors(transcription)
    z = form.start(sample_guess(transcription, np.random.default_rng(3)))
    throttles = form.throttles(z)
    longer, shorter = z.copy(), z.copy()
    longer[form.controls[0]] *= 1.0 + 1e-6
    shorter[form.controls[0]] *= 1.0 - 1e-6
    change = cost.value(form, longer) - cost.value(form, shorter)
    slope = cost.slope(form, z, throttles)[0][0]
    # Central difference of a cost of order 1: rounding eps / 2e-6 = 1e-10 dominates.
    assert change / (2e-6 * throttles[0]) == pytest.approx(slope, abs=1e-8)
