"""What closes a trajectory: norms of its three parts against two levels of bounds."""

import numpy as np
import pytest

from core.tolerances import PAPER, STRICT, violation


def defect(position=(0, 0, 0), velocity=(0, 0, 0), mass=0.0):
    return np.array([*position, *velocity, mass], dtype=float)


def test_the_levels_are_those_of_the_paper_and_ours():
    # Sinha and Beeson 2025: 1 km, 0.1 km/s, 1 kg.
    assert (PAPER.position_km, PAPER.velocity_km_s, PAPER.mass_kg) == (1.0, 0.1, 1.0)
    assert (STRICT.position_km, STRICT.velocity_km_s, STRICT.mass_kg) == (0.1, 1e-4, 0.01)


@pytest.mark.parametrize(
    ("one", "expected"),
    [
        (defect(position=(0.06, 0.0, -0.08)), 1.0),
        (defect(velocity=(0.0, -3e-5, 4e-5)), 0.5),
        (defect(mass=-0.02), 2.0),
        (defect(), 0.0),
    ],
)
def test_the_violation_is_a_euclidean_norm_over_its_bound(one, expected):
    assert violation(one[None, :]) == pytest.approx(expected, abs=1e-15)  # rounding


def test_the_worst_part_of_the_worst_trajectory_counts():
    defects = np.array([defect(mass=0.005), defect(position=(0, 0.3, 0)), defect(velocity=(1e-4, 0, 0))])
    assert violation(defects) == pytest.approx(3.0, abs=1e-15)  # rounding
    assert violation(defects, PAPER) == pytest.approx(0.3, abs=1e-15)


@pytest.mark.parametrize("part", range(7))
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_infinitely_far(part, value):
    defects = np.zeros((2, 7))
    defects[1, part] = value
    assert violation(defects) == np.inf
