"""Every second derivative of weighted defects against differences of the Jacobian, and their pattern."""

import dataclasses

import numpy as np
import pytest

from core.ephemeris import EphemerisTable
from core.ephemeris.tables import coefficients_through, record_nodes
from core.transcription import Transcription, throttle_of
from core.transcription.builder import build_plan
from core.transcription.control import push_bend_of, push_of
from tests.core.partials import assert_partials
from tests.core.transcription.points import TIGHT, problem, random_point

#: Outages, segments, segmentation, legs, rng_seed.
POINTS = [
    ((), 8, "adaptive", 3, 1),
    ((), 6, "adaptive", 1, 2),
    (((3, 1.0),), 8, "adaptive", 4, 1),
    (((7, 1.0),), 9, "adaptive", 4, 2),  # behind the matchpoint
    (((3, 1.0), (7, 9.0)), 9, "adaptive", 3, 1),
    (((3, 1.0), (5, 9.0)), 7, "uniform", 3, 2),
    (((1, 1.0),), 6, "adaptive", 3, 1),  # no node where the outage starts: a leg with a child
    (((5, 1.0),), 8, "adaptive", 2, 1),  # on the matchpoint
    (((3, 1.0), (5, 1.0), (7, 1.0)), 8, "adaptive", 1, 3),  # legs with several children, behind both ends
]


def smooth(outages=(), n_segments=8, segmentation="adaptive", n_legs=1):
    """Return a transcription to a target that is no orbit but a circle, without a kernel's rounding."""
    flown = Transcription(problem(outages, n_segments, segmentation), n_legs, TIGHT)
    t = record_nodes(0.0, 0.5, 80, 12)
    circle = 0.15 * np.stack([np.cos(2.0 * t), np.sin(2.0 * t), np.cos(2.0 * t)], axis=2)
    target = EphemerisTable(0.0, 0.5, coefficients_through(circle))
    flown.setting = dataclasses.replace(flown.setting, target=target)
    return flown


def multipliers(structure, rng_seed=0):
    return np.random.default_rng(rng_seed).normal(size=7 * len(structure.plan.block_plus))


def hessian(flown, structure, z, weights):
    lower = np.zeros((structure.n_variables, structure.n_variables))
    np.add.at(
        lower,
        (structure.hessian_rows, structure.hessian_columns),
        flown.hessian(structure, z, weights),
    )
    return lower + np.tril(lower, -1).T


def assert_hessian(flown, structure, z):
    weights = multipliers(structure)

    def gradient(z):
        _, values = flown.evaluate(structure, z, with_partials=True)
        products = values * weights[structure.rows]
        return np.bincount(structure.columns, weights=products, minlength=structure.n_variables)

    # Steps that change move the Jacobian by 1e-11 to 3e-11, as the processor rounds, 3e-7 over h; h^4 leaves
    # 6e-8 of the most bent column.
    assert_partials(
        hessian(flown, structure, z, weights), gradient, z, step=1e-4, atol=3e-7, rtol=2e-7, order=4
    )


@pytest.mark.parametrize(("outages", "n_segments", "segmentation", "n_legs", "rng_seed"), POINTS)
def test_every_column_is_a_difference_of_the_jacobian(outages, n_segments, segmentation, n_legs, rng_seed):
    flown = smooth(outages, n_segments, segmentation, n_legs)
    assert_hessian(flown, flown.lifted, flown.lift(random_point(flown, rng_seed)))


def vectors(flown, x):
    """Return the plan and the point of a lifted vector whose controls are throttle vectors."""
    z = flown.lift(x)
    for trajectory in flown.layout.trajectories:
        controls = throttle_of(z[trajectory.controls].reshape(-1, 3))
        z[trajectory.controls] = controls.ravel()
    return build_plan(flown.problem, flown.layout, flown.n_legs, (), True), z


def test_every_column_is_right_for_throttle_vectors():
    flown = smooth((((3, 1.0),)), 8, n_legs=3)
    assert_hessian(flown, *vectors(flown, random_point(flown, 1)))


def test_throttle_vectors_fly_as_their_controls():
    flown = smooth((((3, 1.0),)), 8, n_legs=3)
    x = random_point(flown, 1)
    structure, z = vectors(flown, x)
    defects, _ = flown.evaluate(structure, z, with_partials=False)
    expected, _ = flown.evaluate(flown.lifted, flown.lift(x), with_partials=False)
    np.testing.assert_allclose(defects, expected, rtol=0.0, atol=1e-10)  # rounding, magnified a thousandfold


def test_a_profile_during_the_outage_bends_too():
    flown = smooth((((3, 1.0),)), 8, n_legs=3)
    profile = (((0.1, (0.7, 0.3, 0.2)), (0.2, (0.0, 0.0, 0.0))),)
    structure = build_plan(flown.problem, flown.layout, 3, profile)
    assert_hessian(flown, structure, flown.lift(random_point(flown, 1)))


def test_the_final_coast_on_the_orbit_bends_nothing():
    flown = Transcription(problem((((3, 1.0),)), 8), 3, TIGHT)
    z, structure = flown.lift(random_point(flown, 1)), flown.lifted
    found = np.abs(hessian(flown, structure, z, multipliers(structure)))
    times = [i for own in flown.layout.trajectories for i in (own.offset, own.offset + 1, own.offset + 2)]
    final = [own.final_coast for own in flown.layout.trajectories]
    others = np.setdiff1d(np.arange(len(z)), times)
    # Rounding of terms that cancel: those of the times among themselves, which are the greatest here.
    most = found[np.ix_(times, times)].max()
    assert found[np.ix_(final, others)].max() < 1e-10 * most
    assert found[np.ix_(final, times)].max() < 1e-10 * most
    assert most > 1.0


def test_the_pattern_is_a_lower_triangle_without_duplicates():
    structure = smooth((((3, 1.0), (7, 1.0))), 9, n_legs=3).lifted
    rows, columns = structure.hessian_rows, structure.hessian_columns
    assert np.all(columns <= rows) and rows.max() < structure.n_variables
    assert len(set(zip(rows.tolist(), columns.tolist(), strict=True))) == len(rows)


def test_a_coast_of_no_length_has_second_derivatives():
    flown = smooth((), 6, n_legs=2)
    x = random_point(flown, 1)
    x[1] = x[2] = 0.0
    assert np.isfinite(flown.hessian(flown.lifted, flown.lift(x), multipliers(flown.lifted))).all()


def test_where_it_cannot_be_flown_all_are_nan():
    flown = smooth((), 6, n_legs=2)
    z = flown.lift(random_point(flown, 1))
    z[0] = 1e6  # past the ephemeris
    assert np.isnan(flown.hessian(flown.lifted, z, multipliers(flown.lifted))).all()


@pytest.mark.parametrize("is_vector", [False, True])
def test_thrust_and_flow_bend_as_their_slopes_differ(is_vector):
    control, bend = np.array([0.6, -0.4, 0.9]), (np.empty((3, 3, 3)), np.empty((3, 3)))
    push_bend_of(is_vector, control, 1.3, 0.7, *bend)

    def slopes(control):
        slope = np.empty(3), np.empty((3, 3)), np.empty(3)
        push_of(is_vector, control, 1.3, 0.7, *slope)
        return np.concatenate([slope[1], slope[2][:, None]], axis=1)

    found = np.concatenate([bend[0], bend[1][:, :, None]], axis=2).transpose(0, 2, 1)
    assert_partials(found, slopes, control, step=1e-3, atol=1e-10, rtol=1e-10, order=4)  # h^4 and eps/h
