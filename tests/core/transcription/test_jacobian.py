"""Every column of the sparse Jacobian against differences, and its fixed pattern."""

import dataclasses

import numpy as np
import pytest

from core.transcription import Transcription
from tests.core.partials import assert_partials
from tests.core.transcription.points import TIGHT, UNITS, problem, random_point, transcription

#: Outages, segments, segmentation, rng_seed.
POINTS = [
    ((), 50, "adaptive", 1),
    ((), 50, "adaptive", 2),
    (((24, 1.0),), 50, "adaptive", 2),
    (((4, 1.0),), 20, "adaptive", 3),
    (((11, 1.0),), 20, "adaptive", 3),  # on the matchpoint
    (((17, 1.0),), 20, "adaptive", 3),  # behind it
    (((1, 1.0),), 2, "adaptive", 4),
    (((1, 1.0), (8, 0.5)), 9, "adaptive", 1),  # no reference segment before; one segment after
    (((3, 1.0), (6, 9.0)), 9, "uniform", 1),  # an outage longer than a segment
    (((5, 1.0), (7, 2.0), (8, 1.0)), 9, "adaptive", 1),
    (((5, 1.0), (11, 1.0), (16, 1.0)), 20, "adaptive", 1),
]


def assert_jacobian(flown, x):
    """Compare in canonical units, in which all partials are of one size."""
    units = np.tile(UNITS, flown.n_defects // 7)
    found = flown.jacobian(x).toarray() / units[:, None] * flown.scale
    assert_partials(
        found,
        lambda z: flown.defects(z * flown.scale) / units,
        x / flown.scale,
        step=1e-4,
        # Joints of the target, 1.5e-12 LU, magnified a hundredfold by its perilune, over h; h^4 is less.
        atol=2e-6,
        rtol=1e-6,
        order=4,
    )


@pytest.mark.parametrize(("outages", "n_segments", "segmentation", "rng_seed"), POINTS)
def test_every_column_is_a_central_difference(outages, n_segments, segmentation, rng_seed):
    flown = transcription(outages, n_segments, segmentation)
    assert_jacobian(flown, random_point(flown, rng_seed))


def foreign(factor=1.01):
    """Return a transcription whose target is no orbit: the NRHO, blown up about the Moon."""
    flown = Transcription(problem(((3, 1.0), (6, 1.0)), 8), 1, TIGHT)
    table = flown.setting.target
    target = table._replace(coefficients=table.coefficients * factor, is_ballistic=False)
    flown.setting = dataclasses.replace(flown.setting, target=target)
    return flown


def test_every_column_is_right_for_a_target_that_is_not_ballistic():
    flown = foreign()
    assert_jacobian(flown, random_point(flown, 5))


def test_the_final_coast_matters_only_where_the_target_is_not_ballistic():
    columns = []
    for flown in (transcription(((3, 1.0), (6, 1.0)), 8), foreign()):
        x = random_point(flown, 5)
        partials = flown.jacobian(x).toarray()
        columns.append([np.abs(partials[:3, 2]).max(), np.abs(partials[:3, 0]).max()])
    # km per day; the generated orbit is ballistic to its fit error, 1e-9 km/s or 1e-4 km/d, at the perilune.
    assert columns[0][0] < 0.05
    # 1 % too large an orbit needs 1 % of the Moon's pull, 1e-6 km/s^2 at most places, to be followed.
    assert columns[1][0] > 100.0
    assert min(columns[0][1], columns[1][1]) > 1000.0  # and T_s matters everywhere


@pytest.mark.parametrize("hours", [0.0, 1.0, 1e-7, 0.5, 0.999])
def test_the_final_coast_on_the_orbit_changes_nothing_where_records_meet_either(hours):
    flown = transcription((), 8)
    x = random_point(flown, 5)
    # Arrival on a whole hour of the records, which begin five days before departure, and beside it.
    whole = np.ceil((x[0] + x[1] + 1.0) * 24.0) / 24.0
    x[2] = whole + hours / 24.0 - x[0] - x[1]
    column = flown.jacobian(x).toarray()[:, 2]
    # The rates of orbit and flight agree to rounding, 1e-16 of 3 km/s per second or 1e-11 km/d a step, which
    # the way to the matchpoint magnifies up to 10,000 times.
    assert np.abs(column[:3]).max() < 1e-6 and np.abs(column[3:]).max() < 1e-11


def test_the_pattern_does_not_depend_on_the_point_and_has_no_entry_too_many():
    flown = transcription(((5, 1.0), (11, 1.0), (16, 1.0)), 20)
    first, second = (flown.jacobian(random_point(flown, rng_seed)) for rng_seed in (1, 2))
    np.testing.assert_array_equal(first.indices, second.indices)
    np.testing.assert_array_equal(first.indptr, second.indptr)
    # On a ballistic target the final coasts change nothing, and their entries are there for the others.
    final = {own.final_coast for own in flown.layout.trajectories}
    assert set(first.indices[first.data == 0.0].tolist()) <= final


def test_mass_rows_have_the_closed_form():
    flown = transcription(((4, 1.0),), 10)
    x = random_point(flown, 6)
    row = flown.jacobian(x).toarray()[6]
    days = x[0] / 10 * 3.0 * 86400.0 / (2708.0 * 9.806)  # kg of one segment at throttle 1
    assert row[3:33:3] == pytest.approx(-days * np.ones(10), abs=1e-9)  # burnt forward or needed backward
    assert row[0] == pytest.approx(-days / x[0] * x[3:33:3].sum(), abs=1e-9)
    assert row[33] == -1.0 and np.all(row[[1, 2]] == 0.0) and np.all(row[34:] == 0.0)
