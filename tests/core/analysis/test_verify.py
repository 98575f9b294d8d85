from math import isnan

import numpy as np
import pytest
import scipy

from core.tolerances import PAPER, STRICT, violation
from core.verification import verify as judge
from core.verification.verify import holds, verify
from tests.core.analysis import by_hand
from tests.core.analysis.by_hand import known_transfer, problem_with


@pytest.fixture(autouse=True)
def any_coverage(monkeypatch):
    """Take targets that cover the arrivals alone; users' kernels must cover every arrival that x may have."""
    monkeypatch.setattr(judge, "target_kernel", lambda problem: (problem.target.path, problem.target.naif_id))


@pytest.fixture(scope="module")
def transfer(tmp_path_factory):
    """A P_2 and its exact x: initial coasts 2, 0.25 and 0 days, final coasts 0.5, 0.25 and 0.75 days."""
    return known_transfer(tmp_path_factory.mktemp("spk") / "by_hand.bsp")


def test_a_transfer_flown_by_hand_has_no_defects(transfer):
    found = verify(*transfer)
    # LSODA's global error over 12 days rules: metres, a tenth of the strict tolerance.
    assert found.position_km == pytest.approx(np.zeros(3), abs=1e-2)
    assert found.velocity_km_s == pytest.approx(np.zeros(3), abs=1e-6)
    assert found.mass_kg == pytest.approx(np.zeros(3), abs=1e-6)
    assert found.strict and found.paper and found.failure == ""


def test_insertion_is_on_the_target_at_the_epoch_that_x_says(transfer):
    found = verify(*transfer)
    assert found.target_error[:, 0] == pytest.approx(np.zeros(3), abs=1e-2)  # as above
    days = (found.arrival_et - by_hand.ORIGIN_ET) / 86400
    assert days == pytest.approx([11.5, 3.5 + 0.5 + 0.25 + 4.8 + 0.25, 8.0 + 0.5 + 1.0 + 0.75], abs=1e-9)


@pytest.mark.parametrize(
    ("index", "change"),
    [(0, 1e-3), (1, 1e-3), (3, 1e-4), (4, 1e-3), (20, 1e-3), (22, 1e-3), (26, 1e-3), (37, 2e-2), (39, 1e-3)],
)
def test_any_changed_time_or_control_breaks_the_strict_verdict(transfer, index, change):
    problem, x = transfer
    x = x.copy()
    x[index] += change
    assert not verify(problem, x).strict


def test_final_coasts_slide_along_a_ballistic_target(transfer):
    problem, x = transfer
    x = x.copy()
    x[[2, 24, 40]] += 0.01  # the coast grows backwards and the arrival forwards alike
    assert verify(problem, x).strict


def test_mass_defects_are_the_closed_form_forward_minus_backward(transfer):
    problem, x = transfer
    x = x.copy()
    x[21] -= 0.05
    found = verify(problem, x)
    # The late realization starts from the backward half, so it inherits the lighter reference.
    assert found.defects[:, 6] == pytest.approx([0.05, 0.0, -0.05], abs=1e-6)  # LSODA's mass
    assert found.paper and not found.strict


def test_a_vector_outside_its_bounds_is_not_feasible(transfer):
    problem, x = transfer
    narrow = {"bounds": {"shooting_days": [1e-3, 8.9]}}
    path = problem.target.path
    found = verify(problem_with(path, 6, [(2, 0.5), (5, 0.5)], **narrow), x)
    assert holds(found.defects, STRICT)
    assert not (found.is_within_bounds or found.strict or found.paper)


@pytest.mark.parametrize("trajectory", [0, 1, 2])
def test_a_trajectory_that_arrives_with_less_than_the_dry_mass_is_not_feasible(transfer, trajectory):
    problem, x = transfer
    dry_mass_kg = float(x[[21, 37, 44][trajectory]]) + 0.5
    heavy = problem.model_copy(
        update={"spacecraft": problem.spacecraft.model_copy(update={"dry_mass_kg": dry_mass_kg})}
    )
    found = verify(heavy, x)
    assert holds(found.defects, STRICT)
    assert not (found.is_within_bounds or found.strict or found.paper)


def flown_once(problem, x, rtol=1e-13):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(judge, "RTOL", rtol)
        patch.setattr(judge, "NEAR", 1.0)
        return verify(problem, x)


def moved(x, days):
    return np.concatenate([x[:39], [x[39] + days], x[40:]])


def days_at(problem, x, share, *tolerances):
    """Return how much later a realization has to leave to have defects of a share of the strict limit."""

    def excess(days):
        found = [flown_once(problem, moved(x, days), rtol).defects for rtol in tolerances]
        return np.mean([violation(defects) for defects in found]) - share

    return scipy.optimize.brentq(excess, 0.0, 1e-3, xtol=1e-14)


def test_a_vector_whose_verdict_depends_on_the_integrators_tolerance_is_marginal(transfer, monkeypatch):
    problem, x = transfer
    # Far coarser than in earnest, where 12 days make a difference of less than a millimetre.
    monkeypatch.setattr(judge, "FINER_RTOL", 1e-8)
    limit = moved(x, days_at(problem, x, 1.0, 1e-13, 1e-8))
    finer, coarser = (violation(flown_once(problem, limit, rtol).defects) for rtol in (1e-13, 1e-8))
    assert min(finer, coarser) <= 1.0 < max(finer, coarser)
    found = verify(problem, limit)
    assert found.is_marginal and found.paper and not found.strict
    assert violation(found.defects) == max(finer, coarser)
    assert found.tolerance == (1e-13 if finer > coarser else 1e-8)


@pytest.mark.parametrize(("share", "is_flown_twice"), [(0.1, False), (0.5, True), (0.9, True)])
def test_a_second_flight_is_made_where_the_defects_are_near_a_limit(transfer, share, is_flown_twice):
    problem, x = transfer
    near = moved(x, days_at(problem, x, share, 1e-13))
    found = verify(problem, near)
    assert found.strict and not found.is_marginal
    assert (found.n_evaluations > flown_once(problem, near).n_evaluations) == is_flown_twice


def test_every_flight_says_how_close_each_trajectory_comes_to_earth_and_moon(transfer):
    found = verify(*transfer)
    assert [[one.body for one in flown] for flown in found.closest] == 3 * [["Earth", "Moon"]]
    # The reference begins where it is closest to the Earth, or comes closer later.
    assert found.closest[0][0].distance_km <= np.linalg.norm(by_hand.START[:3])


def test_the_norm_of_each_part_is_judged_for_every_trajectory():
    good, bad = np.zeros(7), np.array([0.6, 0.6, 0.6, 0, 0, 0, 0])
    assert holds(np.array([good, good]), STRICT)
    assert not holds(np.array([good, bad]), PAPER)  # |bad| = 1.04 km although no component passes 1 km
    assert not holds(np.array([good, good * np.nan]), PAPER)


def test_a_flight_into_the_earth_is_a_verdict_and_no_exception(transfer):
    problem, x = transfer
    falling = {"position_km": [30000.0, 0, 0], "velocity_km_s": [0.01, 0.0, 0.0]}
    departure = problem.departure.model_dump() | falling
    found = verify(problem_with(problem.target.path, 6, [(2, 0.5), (5, 0.5)], departure=departure), x)
    assert not (found.strict or found.paper)
    assert np.isnan(found.defects).any(axis=1).tolist() == [True, True, False]
    assert "reference meets the Earth" in found.failure and "realization 1 starts from" in found.failure


def test_an_arrival_outside_the_target_is_a_verdict_too(transfer):
    problem, x = transfer
    x = x.copy()
    x[1] += 20.0
    found = verify(problem, x)
    assert isnan(found.position_km[0]) and "reference target: no ephemeris" in found.failure


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda x: x[:-1], r"expected shape \(45,\) for 6 segments and 2 outages, got \(44,\)"),
        (lambda x: np.where(np.arange(45) == 7, np.nan, x), "expected finite numbers, got nan at index 7"),
    ],
)
def test_a_vector_of_another_shape_or_without_a_number_is_refused(transfer, spoil, message):
    problem, x = transfer
    with pytest.raises(ValueError, match=message):
        verify(problem, spoil(x))


def test_the_verdict_names_its_means(transfer):
    found = verify(*transfer)
    assert found.integrator == "scipy.integrate.DOP853" and found.tolerance <= 1e-12
    assert [name for name, _ in found.kernels] == ["de440.bsp", "by_hand.bsp"]
    assert found.n_evaluations > 0
