import json
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from core.analysis.stationarity import Box, projected_gradient, stationarity
from core.problem import load_problem
from core.transcription import transcribe
from tests.core.known import solution


@pytest.fixture(scope="module")
def transcription():
    return transcribe(load_problem("ppe-drm3"))


def box(n, at_lower=(), at_upper=()):
    lower, upper = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    lower[list(at_lower)] = upper[list(at_upper)] = True
    return Box(lower, upper)


def test_the_nearest_point_of_a_plane_is_stationary():
    # min |x|^2/2, x + y + z = 3: x = (1, 1, 1), multiplier -1.
    left, multipliers = projected_gradient(np.ones(3), np.ones((1, 3)), box(3))
    np.testing.assert_allclose(left, 0.0, atol=1e-15)
    np.testing.assert_allclose(multipliers, [-1.0], atol=1e-15)


def test_elsewhere_on_the_plane_the_distance_from_it_is_left():
    # At (3, 0, 0) without bounds the gradient (3, 0, 0) keeps its part in the plane.
    left, _ = projected_gradient(np.array([3.0, 0.0, 0.0]), np.ones((1, 3)), box(3))
    np.testing.assert_allclose(left, [2.0, -1.0, -1.0], atol=1e-14)


def test_a_bound_carries_a_gradient_that_points_out_of_the_box_and_no_other():
    # min x + 2y, x + y = 1, y >= 0: (1, 0), multiplier -1, gradient (0, 1).
    objective, jacobian = np.array([1.0, 2.0]), np.ones((1, 2))
    left, multipliers = projected_gradient(objective, jacobian, box(2, at_lower=[1]))
    np.testing.assert_allclose((*left, *multipliers), (0.0, 0.0, -1.0), atol=1e-15)
    # With y <= 0 instead there is half of the difference left on either variable.
    left, _ = projected_gradient(objective, jacobian, box(2, at_upper=[1]))
    np.testing.assert_allclose(left, [-0.5, 0.5], atol=1e-15)


@pytest.mark.parametrize("rng_seed", range(5))
def test_multipliers_are_those_of_a_bounded_least_squares_solver(rng_seed):
    rng = np.random.default_rng(rng_seed)
    n, m = 60, 7
    objective, jacobian = rng.standard_normal(n), rng.standard_normal((m, n))
    at = box(n, at_lower=range(0, 20), at_upper=range(20, 40))
    left, multipliers = projected_gradient(objective, jacobian, at)
    # |g + J^T m - e_lower + e_upper|^2 with the multipliers of the bounds at least 0.
    sides = np.eye(n)[:, :40] * np.repeat([-1.0, 1.0], 20)
    least = np.repeat([-np.inf, 0.0], [m, 40])
    peer = lsq_linear(np.hstack([jacobian.T, sides]), -objective, (least, np.inf), method="bvls", tol=1e-15)
    np.testing.assert_allclose(multipliers, peer.x[:m], rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.sum(left**2), 2.0 * peer.cost, rtol=1e-12)


def test_scaled_and_repeated_constraints_change_nothing_that_is_left():
    rng = np.random.default_rng(1)
    objective, jacobian = rng.standard_normal(30), rng.standard_normal((4, 30))
    at = box(30, at_lower=range(10))
    left, _ = projected_gradient(objective, jacobian, at)
    scaled = np.vstack([jacobian * np.array([[1e-6], [1.0], [1e3], [1e8]]), jacobian[1] + jacobian[2]])
    again, _ = projected_gradient(objective, scaled, at)
    np.testing.assert_allclose(again, left, rtol=0, atol=1e-12)  # rounding of 30 numbers of size 1


def closed(transcription, x):
    """Return x moved by least-norm Newton steps until its defects vanish."""
    fine = transcription.at_tolerance(1e-12)
    for _ in range(6):
        jacobian = fine.jacobian(x).toarray() * transcription.scale
        x = x - transcription.scale * np.linalg.lstsq(jacobian, fine.defects(x), rcond=1e-13)[0]
    return x


def test_along_the_gradient_that_is_left_a_transfer_gains_the_mass_it_promises(transcription):
    start = closed(transcription, solution())
    found = stationarity(transcription, start)
    assert 1e-4 < found.residual < 1e-2 and not found.is_optimal
    # The throttles at bounds would leave the box; the others are free to move.
    h = 2e-3
    ahead = closed(transcription, start - h * found.gradient * transcription.scale)
    behind = closed(transcription, start + h * found.gradient * transcription.scale)
    gained = (ahead - behind)[transcription.layout.reference.final_mass] / 15000.0 / (2.0 * h)
    assert gained == pytest.approx(
        np.sum(found.gradient**2), rel=1e-3
    )  # central difference of the curved set


def test_what_another_solver_converged_to_is_locally_optimal_and_its_neighbour_is_not(transcription):
    # SciPy's SLSQP on the plain form, 600 iterations with the angles unbounded; it stalled there.
    x = np.array(json.loads((Path(__file__).parent / "optimum.json").read_text(encoding="utf-8")))
    found = stationarity(transcription, x)
    assert found.is_optimal and found.residual == np.max(np.abs(found.gradient))
    layout = transcription.layout.reference
    throttles = x[layout.controls][::3]
    segment = 1 + int(np.flatnonzero((throttles > 0.1) & (throttles < 0.9))[0])
    x[layout.control(segment) + 1] += 0.01
    assert not stationarity(transcription, x).is_optimal


def test_angles_of_unlit_segments_weigh_nothing_and_seams_are_no_bounds(transcription):
    x, layout = solution(), transcription.layout.reference
    x[layout.control(10)] = 0.0
    x[layout.control(20) + 1] = np.pi
    gradient = stationarity(transcription, x).gradient
    assert gradient[layout.control(10) + 1] == gradient[layout.control(10) + 2] == 0.0
    turned = x.copy()
    turned[layout.control(20) + 1] = -np.pi
    np.testing.assert_allclose(stationarity(transcription, turned).gradient, gradient, rtol=0, atol=1e-9)
    assert gradient[layout.control(20) + 1] != 0.0


def test_a_vector_that_cannot_be_flown_is_infinitely_far_from_optimal(transcription, monkeypatch):
    unflown = transcription.jacobian(solution()) * np.nan
    monkeypatch.setattr(type(transcription), "jacobian", lambda self, x: unflown)
    found = stationarity(transcription, solution())
    assert found.residual == np.inf and not found.is_optimal


def test_a_vector_of_another_length_is_refused(transcription):
    with pytest.raises(ValueError, match=r"expected shape \(154,\)"):
        stationarity(transcription, np.zeros(3))
