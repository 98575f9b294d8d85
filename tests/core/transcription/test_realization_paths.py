"""The path under an outage, against the transcription's own defects and against its parts."""

import numpy as np
import pytest

from core.transcription import RealizationPath, ReferencePath, fly_arc, throttle_of
from tests.core.transcription.points import UNITS, random_point, transcription

DAY = 86400.0 / 375190.25852
#: One outage before the matchpoint of the reference, the start of segment 5, and one after it.
OUTAGES = ((3, 1.5), (7, 0.5))


@pytest.fixture(scope="module")
def flown():
    return transcription(OUTAGES, 9)


@pytest.fixture(scope="module")
def x(flown):
    return random_point(flown, 3)


@pytest.mark.parametrize("number", [1, 2])
def test_halves_of_a_realization_miss_each_other_by_its_defect(flown, x, number):
    path, match = RealizationPath(flown, x, number), flown.layout.trajectories[number].matchpoint
    times = path.boundary_time(match + 1), path.boundary_time(match)
    behind = fly_arc(flown, path.boundaries[match], *times, path.controls[match - 1])
    missed = (path.boundaries[match - 1] - behind) * UNITS
    # The same arcs at tolerance 1e-13, epochs rounded elsewhere.
    np.testing.assert_allclose(missed, flown.defects(x).reshape(-1, 7)[number], rtol=0, atol=1e-4)


@pytest.mark.parametrize(("number", "segment", "days"), [(1, 3, 1.5), (2, 7, 0.5)])
def test_a_realization_leaves_the_reference_as_its_outage_begins(flown, x, number, segment, days):
    path, reference = RealizationPath(flown, x, number), ReferencePath(flown, x)
    begin, own = reference.boundary_time(segment), flown.layout.trajectories[number]
    assert path.boundary_time(1) == pytest.approx(begin + (days + x[own.initial_coast]) * DAY, abs=1e-13)
    assert path.edges == [
        *reference.edges[:segment],
        *(path.boundary_time(p) for p in range(1, 11 - segment)),
    ]
    for t in (0.4 * begin, begin - 1e-3):
        np.testing.assert_array_equal(path.state(t), reference.state(t))
        np.testing.assert_array_equal(path.control(t), reference.control(t))
    later = fly_arc(flown, reference.boundaries[segment - 1], begin, begin + days * DAY)
    # There and back at tolerance 1e-13, magnified along the coast.
    np.testing.assert_allclose(path.state(begin + days * DAY), later, rtol=0, atol=1e-9)


def test_the_mean_throttle_of_a_realization_counts_its_coasts_as_nothing(flown, x):
    path, reference = RealizationPath(flown, x, 1), ReferencePath(flown, x)
    begin, shooting = reference.boundary_time(3), path.boundary_time(1)
    start, end = begin - 0.5 * reference.segment_time, shooting + 0.25 * path.segment_time
    before, after = throttle_of(reference.controls)[1], throttle_of(path.controls)[0]
    impulse = 0.5 * reference.segment_time * before + 0.25 * path.segment_time * after
    assert path.mean_throttle(start, end) == pytest.approx(impulse / (end - start), abs=1e-13)  # rounding
    assert np.all(path.mean_throttle(begin, shooting) == 0.0)
