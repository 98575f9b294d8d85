"""The messages read back by Brad Sease's `oem`, which knows the standard and not us."""

import numpy as np
import pytest
import spiceypy
from astropy.time import Time, TimeDelta
from oem import OrbitEphemerisMessage

from core.ephemeris import furnish
from core.export import oem_lines, write_spk
from core.export.spk import body_id
from tests.core.export.solution import trajectories

CREATED = "2026-11-25T21:00:00"
J2000 = Time("2000-01-01T12:00:00", scale="tdb")


@pytest.fixture(scope="module", params=[0, 1])
def message(request, tmp_path_factory):
    own = trajectories()[request.param]
    path = tmp_path_factory.mktemp("oem") / "trajectory.oem"
    lines = oem_lines(own, "-60100", f"coastarc {own.name}", CREATED, ["from a test", ""])
    path.write_text("".join(lines), encoding="ascii")
    return own, path, OrbitEphemerisMessage.open(path)


def test_an_independent_reader_finds_frame_centre_and_time_scale(message):
    own, _, read = message
    assert read.version == "2.0" and len(read.segments) == len(own.arcs)
    assert (read.header["ORIGINATOR"], str(read.header["CREATION_DATE"].isot)[:19]) == ("COASTARC", CREATED)
    for segment in read:
        found = [segment.metadata[key] for key in ("CENTER_NAME", "REF_FRAME", "TIME_SYSTEM")]
        assert found == ["EARTH", "ICRF", "TDB"]


def test_an_independent_reader_finds_the_same_states(message):
    own, _, read = message
    for segment, arc in zip(read, own.arcs, strict=True):
        states = list(segment.states)
        et = np.array([(state.epoch - J2000).sec for state in states])
        np.testing.assert_allclose(et, arc.et, rtol=0, atol=1e-6)  # microseconds are written
        found = np.array([[*state.position, *state.velocity] for state in states])
        # As many digits as a double has of a distance of 4e5 km.
        np.testing.assert_allclose(found[:, :3], arc.states[:, :3], rtol=0, atol=1e-10)
        np.testing.assert_allclose(found[:, 3:], arc.states[:, 3:6], rtol=0, atol=1e-14)


def test_an_independent_reader_interpolates_to_what_spice_reads_from_the_spk(message, tmp_path):
    own, _, read = message
    kernel = tmp_path / "same.bsp"
    write_spk(kernel, [own], "same")
    furnish(kernel)
    for segment, arc in zip(read, own.arcs, strict=True):
        longest = int(np.argmax(np.diff(arc.et)))
        middle = 0.5 * (arc.et[longest] + arc.et[longest + 1])
        found = segment(J2000 + TimeDelta(middle, format="sec", scale="tdb"))
        expected = spiceypy.spkgeo(body_id(own.index), middle, "J2000", 399)[0]
        # Its polynomials are solved for in powers of seconds, which costs digits; ten metres are promised.
        assert np.linalg.norm(found.position - expected[:3]) < 0.01
    spiceypy.unload(str(kernel))


def test_comments_tell_mass_and_thrust_of_each_arc_and_lines_stay_short(message):
    own, path, _ = message
    lines = path.read_text(encoding="ascii").splitlines()
    assert max(map(len, lines)) <= 254
    assert lines[:2] == ["CCSDS_OEM_VERS = 2.0", "COMMENT from a test"]
    thrusts = [line for line in lines if line.startswith("COMMENT thrust in the axes")]
    assert len(thrusts) == len(own.arcs)
    found = [[float(word) for word in line.split()[8:11]] for line in thrusts]
    np.testing.assert_allclose(found, [arc.thrust_n for arc in own.arcs], rtol=0, atol=1e-9)
