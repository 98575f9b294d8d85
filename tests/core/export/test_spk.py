"""The SPK against SciPy and SPICE, between its samples."""

import numpy as np
import pytest
import spiceypy

from core.ephemeris import furnish
from core.export import write_spk
from core.export.spk import FIRST_ID, body_id
from core.orbits import target_kernel
from tests.core.export.solution import (
    PROBLEM,
    ends_of,
    flown_between_samples,
    flown_from_samples,
    trajectories,
)


@pytest.fixture(scope="module")
def kernel(tmp_path_factory):
    path = tmp_path_factory.mktemp("spk") / "solution.bsp"
    write_spk(path, trajectories(), "first line\nsecond line")
    furnish(path, target_kernel(PROBLEM)[0])
    yield path
    spiceypy.unload(str(path))


@pytest.mark.parametrize("index", [0, 1])
def test_spice_reads_the_flight_of_an_independent_integrator_between_the_samples(kernel, index):
    own = trajectories()[index]
    worst = np.zeros(2)
    for et, state in flown_between_samples(own, ends_of(own)):
        read = spiceypy.spkgeo(body_id(index), et, "J2000", 399)[0]
        worst = np.maximum(
            worst, [np.linalg.norm((read - state[:6])[part]) for part in (slice(3), slice(3, 6))]
        )
    # Ten metres are promised.
    assert worst[0] < 0.01 and worst[1] < 1e-7, worst


def test_what_is_read_between_two_samples_is_the_flight_from_the_one_before(kernel):
    for own in trajectories():
        for arc in own.arcs:
            for et, state in flown_from_samples(own, arc, [0, len(arc.et) // 2, len(arc.et) - 2]):
                read = spiceypy.spkgeo(body_id(own.index), et, "J2000", 399)[0]
                # Epochs are spaced by 1.2e-7 s, in which a spacecraft moves 3e-7 km: noise on positions, of
                # which the polynomial's slope halfway between two samples adds up some eight per step.
                noise, step = (
                    np.linalg.norm(state[3:6]) * np.spacing(et),
                    2.0 * (et - arc.et[arc.et <= et][-1]),
                )
                assert np.linalg.norm(read[:3] - state[:3]) < 1e-6
                assert np.linalg.norm(read[3:] - state[3:6]) < 5e-9 + 8.0 * noise / step


def test_every_trajectory_is_a_body_that_is_covered_from_departure_to_arrival(kernel):
    ids = [FIRST_ID - own.index for own in trajectories()]
    assert sorted(spiceypy.spkobj(str(kernel))) == sorted(ids)
    for own, body in zip(trajectories(), ids, strict=True):
        covered = spiceypy.spkcov(str(kernel), body)
        assert spiceypy.wncard(covered) == 1
        assert tuple(spiceypy.wnfetd(covered, 0)) == (own.start_et, own.stop_et)


def test_a_trajectory_leaves_the_departure_and_joins_the_target(kernel):
    for own in trajectories():
        departed = spiceypy.spkgeo(body_id(own.index), own.start_et, "J2000", 399)[0]
        # The departure goes through canonical units and back.
        np.testing.assert_allclose(departed[:3], PROBLEM.departure.position_km, rtol=1e-14)
        from_target = spiceypy.spkgeo(body_id(own.index), own.stop_et, "J2000", target_kernel(PROBLEM)[1])[0]
        # The table of the target against its kernel: tests/core/orbits/test_target.py allows 1e-6 and 1e-9.
        assert np.linalg.norm(from_target[:3]) < 2e-6 and np.linalg.norm(from_target[3:]) < 2e-9


def test_the_comment_area_says_what_it_was_given(kernel):
    handle = spiceypy.dafopr(str(kernel))
    n_lines, lines, is_done = spiceypy.dafec(handle, 10, 80)
    spiceypy.dafcls(handle)
    assert (n_lines, [line.strip() for line in lines][:2], is_done) == (
        2,
        ["first line", "second line"],
        True,
    )


def test_the_same_trajectories_make_the_same_file_and_a_failure_none(kernel, tmp_path):
    path = tmp_path / "again.bsp"
    write_spk(path, trajectories(), "first line\nsecond line")
    assert path.read_bytes() == kernel.read_bytes()
    with pytest.raises(spiceypy.exceptions.SpiceyError):
        write_spk(tmp_path / "none.bsp", [], "no segment")
    assert [entry.name for entry in tmp_path.iterdir()] == ["again.bsp"]
