"""Kernels as users have them: damaged, of other kinds, in odd places; each is refused in one line."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import spiceypy

from core.ephemeris import KernelError, furnish, kernels
from core.ephemeris.daf import SpkError, segments_of
from core.ephemeris.kernels import loaded, planetary_kernel
from core.ephemeris.spk import ChebyshevOrbit, check_coverage, new_spk, orbit_of, read_orbit, write_orbit

BODY, SPAN = -31415, (0.0, 20 * 86400.0)
CENTRE, FRAME = 301, "J2000"
RATE = 2 * np.pi / (10 * 86400.0)


def circle(et):
    cosine, sine, zero = np.cos(RATE * et), np.sin(RATE * et), 0 * et
    return 5e4 * np.column_stack([cosine, sine, zero, -RATE * sine, RATE * cosine, zero])


def add(handle, kind, start, stop, frame=FRAME, centre=CENTRE, body=BODY):
    et = np.arange(start, stop + 1.0, 3600.0)
    common = handle, body, centre, frame, et[0], et[-1], "circle"
    if kind == 13:
        spiceypy.spkw13(*common, 7, len(et), circle(et), et)
    elif kind == 9:
        spiceypy.spkw09(*common, 7, len(et), circle(et), et)
    elif kind == 8:
        spiceypy.spkw08(*common, 7, len(et), circle(et), et[0], 3600.0)
    elif kind == 5:
        spiceypy.spkw05(*common, RATE**2 * 5e4**3, len(et), circle(et), et)


def kernel(path, kind=13, spans=(SPAN,), **more):
    if kind == 2:
        coefficients = np.zeros((20, 12, 3))
        coefficients[:, 0] = 5e4
        write_orbit(path, BODY, ChebyshevOrbit(SPAN[0], 86400.0, coefficients), "a place")
        return path
    with new_spk(path, "a circle") as handle:
        for start, stop in spans:
            add(handle, kind, start, stop, **more)
    return path


def read(path, span=SPAN):
    """Do all that coastarc does with a user's kernel before it loads it."""
    check_coverage(path, BODY, *span)
    return orbit_of(path, BODY, *span, str(path.stat().st_mtime_ns))


@pytest.mark.parametrize("kind", [2, 5, 8, 9, 13])
def test_a_sound_kernel_of_any_type_is_read(kind, tmp_path):
    path = kernel(tmp_path / "größer als sonst.bsp", kind)
    (segment,) = segments_of(path)
    assert segment[:6] == (*SPAN, BODY, CENTRE, 1, kind)
    orbit = read(path)
    expected = 5e4 * (np.sqrt(3.0) if kind == 2 else 1.0)
    place = orbit.coefficients[0].sum(axis=0)
    assert np.linalg.norm(place) == pytest.approx(expected, abs=2e-4)  # what a fit may leave out


def not_a_kernel(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    return tmp_path / name


WRONG = {
    "empty": (b"", "expected an SPK kernel, got a file of kind empty"),
    "text kernel": (b"KPL/MK\n\\begindata\nKERNELS_TO_LOAD=('/etc/passwd')\n", "got a file of kind 'KPL/MK"),
    "transfer": (b"DAFETF NAIF DAF ENCODED TRANSFER FILE\n", "got one in transfer format; .*tobin"),
    "orientation": (b"DAF/CK  " + bytes(1016), "got a file of kind 'DAF/CK'"),
    "head alone": (b"DAF/SPK " + bytes(100), "expected a sound SPK kernel, got a first record"),
    "zeros": (b"DAF/SPK " + bytes(4088), "expected a sound SPK kernel, got a first record"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_spk_is_refused_for_what_it_is(name, tmp_path):
    content, reason = WRONG[name]
    with pytest.raises(SpkError, match=reason):
        read(not_a_kernel(tmp_path, "target.bsp", content))


def test_a_folder_a_pipe_and_an_absent_file_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.bsp")
    for path in (tmp_path, tmp_path / "pipe.bsp"):
        with pytest.raises(SpkError, match="expected an SPK file, got no regular file"):
            segments_of(path)
    with pytest.raises(SpkError, match="expected a readable SPK kernel, got No such file or directory"):
        segments_of(tmp_path / "none.bsp")


@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
def test_a_kernel_that_is_cut_off_is_refused_with_its_length(share, tmp_path):
    path = kernel(tmp_path / "whole.bsp")
    content = path.read_bytes()
    cut = not_a_kernel(tmp_path, "cut.bsp", content[: int(share * len(content))])
    with pytest.raises(SpkError, match=r"expected a whole SPK kernel of \d+ bytes, got \d+; copy it again"):
        read(cut)


def test_a_gap_inside_the_span_is_named(tmp_path):
    path = kernel(tmp_path / "gap.bsp", spans=((0.0, 864000.0), (950400.0, SPAN[1])))
    with pytest.raises(SpkError, match=r"got a gap over 2000-01-11T12:00:00\.0+\.\.2000-01-12T12:00:00\.0+$"):
        read(path)
    whole = kernel(tmp_path / "whole.bsp", spans=((0.0, 864000.0), (864000.0, SPAN[1])))
    read(whole)


def test_a_frame_that_needs_further_kernels_is_refused(tmp_path):
    read(kernel(tmp_path / "ecliptic.bsp", frame="ECLIPJ2000"))
    with pytest.raises(SpkError, match=r"in a frame that is built into SPICE, like J2000, got frame 10020"):
        read(kernel(tmp_path / "fixed.bsp", frame="IAU_MOON"))


def test_a_path_that_spice_cannot_hold_is_refused_with_its_length(tmp_path):
    folder = tmp_path / ("a" * 120) / ("b" * 120)
    folder.mkdir(parents=True)
    long = Path(kernel(tmp_path / "a.bsp").replace(folder / "target.bsp"))
    n_bytes = len(os.fsencode(long))
    with pytest.raises(KernelError, match=f"expected a path of at most 255 bytes, got {n_bytes}; move it"):
        furnish(long)
    link = tmp_path / "b.bsp"
    link.symlink_to(long)
    furnish(link)


def test_a_path_that_spice_would_take_for_another_is_refused(tmp_path):
    for name in ("blank.bsp ", "line\n.bsp"):
        path = kernel(tmp_path / "a.bsp").replace(tmp_path / name)
        with pytest.raises(KernelError, match="printable letters without blanks at its ends, got"):
            furnish(path)


def test_the_planets_stay_loaded_where_they_are_a_target_or_the_bodies_of_a_world(tmp_path):
    with loaded(planetary_kernel().resolve()):
        spiceypy.spkgps(301, 0.0, "J2000", 399)
    furnish(planetary_kernel())
    for n in range(20):
        furnish(kernel(tmp_path / f"{n}.bsp"))
    spiceypy.spkgps(301, 0.0, "J2000", 399)


def moon():
    return spiceypy.spkpos("MOON", 0.0, "J2000", "NONE", "EARTH")[0]


def test_a_kernel_whose_file_is_gone_leaves_the_others_as_they_are(tmp_path):
    furnish()
    where = moon()
    still = ChebyshevOrbit(-86400.0, 2 * 86400.0, np.full((1, 2, 3), 4e5))
    bodies = tmp_path / "bodies.bsp"
    write_orbit(bodies, 301, still, "a Moon that stands still", 399)
    with loaded(bodies):
        assert not np.allclose(moon(), where)
        bodies.unlink()
    np.testing.assert_array_equal(moon(), where)
    # More than are kept, so that those that are gone make room.
    for number in range(12):
        path = tmp_path / f"{number}.bsp"
        write_orbit(path, -77, still, "a target", 399)
        furnish(path)
        assert spiceypy.spkpos("-77", 0.0, "J2000", "NONE", "EARTH")[0][0] == 4e5
        path.unlink()
    np.testing.assert_array_equal(moon(), where)


def test_kernels_do_not_pile_up(tmp_path):
    furnish()
    alone = spiceypy.ktotal("ALL") - len(kernels._furnished)
    for n in range(40):
        furnish(kernel(tmp_path / f"{n}.bsp"))
    assert spiceypy.ktotal("ALL") == alone + kernels._MOST_FURTHER
    place = spiceypy.spkgps(BODY, 86400.0, "J2000", 301)[0]
    np.testing.assert_allclose(place, circle(np.array([86400.0]))[0, :3])
    broken = not_a_kernel(tmp_path, "broken.bsp", kernel(tmp_path / "a.bsp").read_bytes()[:500])
    with pytest.raises(KernelError, match=r"broken\.bsp: expected a file that SPICE can load, got SPICE\("):
        furnish(broken)
    assert spiceypy.ktotal("ALL") <= alone + kernels._MOST_FURTHER


#: How many damaged copies of a kernel are tried.
N_DAMAGED = 150

FUZZ = """
import sys
from pathlib import Path
import numpy as np
from core.ephemeris.daf import SpkError
from core.ephemeris.spk import check_coverage, try_out

sound, folder = Path(sys.argv[1]).read_bytes(), Path(sys.argv[2])
body, stop, first, last = map(float, sys.argv[3:])
damaged = folder / "damaged.bsp"
for rng_seed in range(int(first), int(last)):
    rng = np.random.default_rng(rng_seed)
    content = bytearray(sound)
    for _ in range(rng.integers(1, 4)):
        # Half of the damage to what describes the rest: the first records, and the end of the segment.
        ranges = ((0, 1024), (2048, 2048 + 128), (len(sound) - 1024, len(sound)), (0, len(sound)))
        content[rng.integers(*ranges[rng.integers(4)])] = rng.integers(256)
    if rng.random() < 0.2:
        content = content[: rng.integers(len(content))]
    damaged.unlink(missing_ok=True)
    damaged.write_bytes(content)
    sys.stderr.write(f"{rng_seed}\\n")
    sys.stderr.flush()
    sys.stdout = open("/dev/null", "w")
    try:
        check_coverage(damaged, int(body), 0.0, stop)
        try_out(str(damaged), int(body), 0.0, stop, 301)
    except SpkError as error:
        assert "\\n" not in str(error), error
        sys.stderr.write(f"{error}\\n")
    except SystemExit as end:
        assert end.code == 3, end.code
"""


@pytest.mark.slow
@pytest.mark.parametrize("kind", [2, 5, 8, 9, 13])
def test_damage_is_refused_or_does_no_harm(kind, tmp_path):
    path, first, stderr = kernel(tmp_path / "sound.bsp", kind), 0, ""
    while first < N_DAMAGED:
        arguments = str(path), str(tmp_path), str(BODY), str(SPAN[1]), str(first), str(N_DAMAGED)
        said = subprocess.run([sys.executable, "-c", FUZZ, *arguments], capture_output=True, timeout=500)
        assert said.returncode <= 0 and said.stdout == b"", said.stderr[-500:]
        stderr += said.stderr.decode()
        first = 1 + int(re.findall(r"^(\d+)$", stderr, re.MULTILINE)[-1])
        if said.returncode < 0:
            # SPICE itself ended the process: what the trial is for.
            with pytest.raises(SpkError, match=r"^target .*damaged.bsp: expected .*, got .*$"):
                read(tmp_path / "damaged.bsp")
    assert first == N_DAMAGED
    assert stderr.count("expected ") > 30 and "Traceback (most recent call last)" not in stderr


def test_a_kernel_at_which_spice_dies_ends_its_own_process_alone(tmp_path, monkeypatch):
    from core.ephemeris import spk

    path = kernel(tmp_path / "a.bsp")
    monkeypatch.setattr(spk, "_TRIAL", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV) # {} {}")
    with pytest.raises(SpkError, match="that SPICE can read, got exit code -11 of the"):
        orbit_of(path, BODY, *SPAN, "died")


def test_records_that_the_segment_does_not_mean_are_fitted_instead(tmp_path):
    path = kernel(tmp_path / "a.bsp", 2)
    assert read_orbit(path, BODY) is not None
    content = bytearray(path.read_bytes())
    (segment,) = segments_of(path)
    place = 8 * (segment.first - 1)
    content[place : place + 8] = np.float64(43000.0).tobytes()  # the middle of the first record, 200 s off
    path.write_bytes(content)
    assert read_orbit(path, BODY) is None
