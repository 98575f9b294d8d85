"""Bounds that reach further than the flagship's."""

import numpy as np

from core import load_problem, problem_from, transcribe, verify

LONG = {"preset": "ppe-drm3", "bounds": {"shooting_days": [1.0, 150.0], "initial_coast_days": [0.0, 60.0]}}


def flown_twice(problem, shooting, initial, final):
    """Return the defects of a transfer at half throttle, ours and the verifier's."""
    transcription = transcribe(problem, tolerance=1e-12)
    x = np.mean(transcription.bounds, axis=0)
    x[:3] = shooting, initial, final
    return transcription.defects(x), verify(problem, x).defects.ravel()


def test_an_arrival_after_230_days_is_flown_as_the_verifier_flies_it():
    found, expected = flown_twice(problem_from(LONG), 140.0, 60.0, 30.0)
    # Two integrators at 1e-12 over 230 days agree to metres.
    np.testing.assert_allclose(found, expected, atol=0.01)


def test_all_problems_of_a_family_fly_to_one_target():
    problem = problem_from(LONG)
    assert problem.with_outages([(24, 20.0)]).latest_arrival_days == problem.latest_arrival_days


def test_the_verifier_reads_the_target_of_its_own_problem():
    # Both windows make an NRHO of their own, under one identifier, hundreds of kilometres apart.
    for problem in (load_problem("ppe-drm3"), problem_from(LONG), load_problem("ppe-drm3")):
        found, expected = flown_twice(problem, 45.0, 15.0, 15.0)
        np.testing.assert_allclose(found, expected, atol=0.01)  # metres, as above
