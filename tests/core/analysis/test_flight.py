import numpy as np
import pytest

from core.analysis.flight import fly, to_rotating
from core.problem import load_problem
from core.transcription import transcribe
from core.verification.verify import verify

PROBLEM = load_problem("ppe-drm3").with_outages([(10, 1.0), (40, 1.5)])


@pytest.fixture(scope="module")
def x():
    """A vector that closes nowhere; coasts of 0.5 and 2 days, segments of half a day."""
    layout, rng = transcribe(PROBLEM, n_legs=1).layout, np.random.default_rng(7)
    vector = np.empty(layout.n_variables)
    for part in layout.trajectories:
        n = part.n_segments
        vector[part.offset : part.offset + 3] = [0.5 * n, 0.5, 2.0]
        vector[part.controls] = rng.uniform([0, -1, -0.5], [1, 1, 0.5], (n, 3)).ravel()
        vector[part.final_mass] = 12950.0
    return vector


@pytest.fixture(scope="module")
def flight(x):
    return fly(PROBLEM, x)


def test_the_jump_at_the_matchpoint_is_the_defect_that_the_verifier_finds(flight, x):
    defects = verify(PROBLEM, x).defects
    for trajectory, defect in zip(flight.trajectories, defects, strict=True):
        before, after = trajectory.matchpoint - 1, trajectory.matchpoint
        jump = trajectory.inertial_km[before] - trajectory.inertial_km[after]
        assert jump == pytest.approx(defect[:3], abs=1.0)  # steps of 1e-9 LU, amplified on the way
        assert trajectory.mass_kg[before] - trajectory.mass_kg[after] == pytest.approx(defect[6], abs=1e-6)
        assert trajectory.days[before] == pytest.approx(trajectory.days[after], abs=1e-9)


def test_arcs_follow_each_other_without_gap_and_name_their_kind(flight):
    kinds = [[arc.kind for arc in trajectory.arcs] for trajectory in flight.trajectories]
    assert kinds[0] == ["coast", *["thrust"] * 50, "coast"]
    assert kinds[1] == ["outage", "coast", *["thrust"] * 40, "coast"]
    for trajectory in flight.trajectories:
        for arc, after in zip(trajectory.arcs, trajectory.arcs[1:], strict=False):
            assert arc.stop == after.first
            assert trajectory.days[arc.stop - 1] == pytest.approx(trajectory.days[after.first], abs=1e-9)


def test_an_outage_starts_on_the_reference_and_lasts_its_duration(flight):
    reference = flight.trajectories[0]
    for trajectory in flight.trajectories[1:]:
        outage, arc = trajectory.outage, trajectory.arcs[0]
        segment = reference.arcs[outage.segment]
        # In the backward half the missed segment starts at the sample that closes the one before.
        assert trajectory.days[0] == pytest.approx(reference.days[segment.first], abs=1e-9)
        assert trajectory.inertial_km[0] == pytest.approx(reference.inertial_km[segment.first], abs=1e-6)
        assert np.ptp(trajectory.days[arc.first : arc.stop]) == pytest.approx(outage.duration_days, abs=1e-9)


def test_the_last_sample_is_on_the_target_and_has_the_final_mass(flight):
    reference = flight.trajectories[0]
    at = np.argmin(np.abs(flight.target.days - reference.days[-1]))
    # The target is drawn every 0.01 d, in which it moves less than 1.8 km/s x 432 s.
    assert np.linalg.norm(flight.target.inertial_km[at] - reference.inertial_km[-1]) < 800.0
    assert reference.mass_kg[-1] == pytest.approx(12950.0, abs=1e-9)


def test_samples_turn_less_than_a_tenth_of_a_radian_about_either_body(flight):
    reference = flight.trajectories[0]
    for centre in (0.0, reference.moon_km):
        place = reference.inertial_km - centre
        place = place / np.linalg.norm(place, axis=1, keepdims=True)
        turn = np.arccos(np.clip(np.sum(place[1:] * place[:-1], axis=1), -1.0, 1.0))
        turn[reference.matchpoint - 1] = 0.0
        # A twentieth of a radian on a circle; at perilune of an eccentric orbit sqrt(2) times as much.
        assert turn.max() < 0.1


def test_the_moon_stays_put_in_the_rotating_frame(flight):
    place = np.broadcast_to([384400.0, 0.0, 0.0], flight.moon.rotating_km.shape)
    assert flight.moon.rotating_km == pytest.approx(place, abs=1e-6)  # rounding of 4e5 km


def test_the_rotating_frame_keeps_ratios_of_lengths_and_the_side_of_the_orbit_plane():
    moon, velocity = np.array([[0.0, 4e5, 0.0]]), np.array([[-1.0, 0.0, 0.0]])
    found = to_rotating(np.array([[-2e5, 4e5, 1e5]]), moon, velocity)
    scale = 384400.0 / 4e5
    assert found == pytest.approx(scale * np.array([[4e5, 2e5, 1e5]]), rel=1e-14)  # rounding


def test_a_vector_of_another_shape_is_refused(x):
    with pytest.raises(ValueError, match="decision vector: expected shape"):
        fly(PROBLEM, x[:-1])
