"""Single states and arcs: the target against SPICE, the path of a reference against its definition."""

import numpy as np
import pytest
import spiceypy

from core.ephemeris import furnish
from core.orbits import target_kernel
from core.transcription import ReferencePath, fly_arc, target_state, throttle_of
from tests.core.transcription.points import PRESET, UNITS, random_point, transcription

DAY = 86400.0 / 375190.25852


def test_the_target_is_where_spice_says():
    furnish()
    path, naif_id = target_kernel(PRESET)
    spiceypy.furnsh(str(path))
    et = spiceypy.str2et("2026-04-26 14:47:58 TDB")
    for days in (0.0, 33.3, 120.0):
        expected, _ = spiceypy.spkez(naif_id, et + days * 86400.0, "J2000", "NONE", 399)
        found = target_state(transcription(), days * DAY, 0.5) * UNITS
        assert found[:3] == pytest.approx(expected[:3], abs=1e-5)  # fit of the Moon's table, 2e-7 km
        assert found[3:] == pytest.approx([*expected[3:], 7500.0], abs=1e-8)
    spiceypy.unload(str(path))


@pytest.fixture(scope="module")
def flown():
    return transcription((), 9)


@pytest.fixture(scope="module")
def path(flown):
    return ReferencePath(flown, random_point(flown, 3))


def test_a_path_starts_at_departure_and_ends_on_the_target(flown, path):
    x = random_point(flown, 3)
    start = fly_arc(flown, path.boundaries[0], path.shooting_start, 0.0) * UNITS
    craft = PRESET.departure
    # There and back at tolerance 1e-13.
    assert start == pytest.approx([*craft.position_km, *craft.velocity_km_s, craft.mass_kg], abs=1e-5)
    end = fly_arc(flown, path.boundaries[-1], path.boundary_time(10), path.arrival)
    assert path.arrival == pytest.approx((x[0] + x[1] + x[2]) * DAY, abs=1e-13)
    expected = target_state(flown, path.arrival, x[-1] / 15000.0)
    np.testing.assert_allclose(end, expected, rtol=0, atol=1e-10)  # 1e-13, magnified by a perilune passage


def test_neighbouring_boundaries_are_joined_by_their_segment(flown, path):
    for p in (1, 3, 6, 9):
        times = path.boundary_time(p), path.boundary_time(p + 1)
        end = fly_arc(flown, path.boundaries[p - 1], *times, path.controls[p - 1])
        # Twice tolerance 1e-13, magnified along the arc.
        np.testing.assert_allclose(end, path.boundaries[p], rtol=0, atol=1e-10)


def test_halves_of_a_path_miss_each_other_by_the_defect(flown, path):
    x = random_point(flown, 3)
    last = path.boundary_time(4), path.boundary_time(5)
    forward = fly_arc(flown, path.boundaries[3], *last, path.controls[3])
    # Boundary 5 is the matchpoint of nine segments and belongs to the forward half.
    np.testing.assert_allclose(forward, path.boundaries[4], rtol=0, atol=1e-12)
    behind = fly_arc(flown, path.boundaries[5], path.boundary_time(6), last[1], path.controls[4])
    np.testing.assert_allclose((forward - behind) * UNITS, flown.defects(x), rtol=0, atol=1e-5)


def test_a_state_between_boundaries_lies_on_the_arc_to_the_next(flown, path):
    t = path.boundary_time(7) + 0.3 * path.segment_time
    end = fly_arc(flown, path.state(t), t, path.boundary_time(8), path.controls[6])
    np.testing.assert_allclose(end, path.boundaries[7], rtol=0, atol=1e-10)  # as above


def test_the_mean_throttle_weighs_segments_by_their_share(path):
    levels = throttle_of(path.controls)
    start, h = path.boundary_time(2), path.segment_time
    expected = (0.5 * levels[1] + levels[2] + 0.25 * levels[3]) / 1.75
    assert path.mean_throttle(start + 0.5 * h, start + 2.25 * h) == pytest.approx(expected, abs=1e-13)
    beyond = path.mean_throttle(path.boundary_time(9), path.boundary_time(9) + 2 * h)
    assert beyond == pytest.approx(levels[8] / 2, abs=1e-13)  # the final coast has no thrust


def test_an_arc_beyond_the_tables_is_not_a_number(flown, path):
    assert np.isnan(fly_arc(flown, path.boundaries[0], 0.0, 300.0 * DAY)).all()
