"""Orbits about the Moon as SPK kernels, in Chebyshev records of one length (SPK type 2).

Frame: J2000 axes, origin at the Moon.  Units: km, TDB s past J2000.

A user's kernel is read in three steps: `core.ephemeris.daf` validates its bytes, `orbit_of` runs all later
SPICE calls in a separate process, and only then it is loaded into this one.
"""

import functools
import io
import itertools
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import spiceypy
from numpy.typing import NDArray
from spiceypy.utils.exceptions import SpiceyError

from core.constants import SECONDS_PER_DAY
from core.ephemeris.daf import INERTIAL_FRAMES, SpkError, segments_of
from core.ephemeris.kernels import KernelError, furnish, planetary_kernel, spice_name
from core.ephemeris.tables import MIN_COEFFICIENTS, coefficients_through, record_nodes
from core.epochs import calendar_epoch
from core.world import BODIES

Array = NDArray[np.float64]

MOON_ID = 301
#: What DE440 holds: barycentres of planets, the Sun, Mercury, Venus, the Moon and the Earth.
SOLAR_SYSTEM = frozenset({*range(11), 199, 299, MOON_ID, 399})
_J2000_FRAME, _CHEBYSHEV_POSITION = 1, 2

# Of a fit to a given kernel.  SPICE's epochs are spaced by 1e-7 s, which the rates feel most.
_FIT_TOLERANCE_KM, _FIT_TOLERANCE_KM_S = 1e-4, 1e-7
_FIT_COEFFICIENTS = 16
_SHORTEST_RECORD_S = 600.0

# Epochs of two records that are one [s]; epochs of SPICE are spaced by 1e-7 s.
_SAME_S = 1e-5
# Spans of a kernel that a message lists.
_MOST_SPANS = 3
# How long a kernel may be tried [s], and at how many epochs where nothing is fitted.
_TRIAL_S, _TRIED_EPOCHS = 300.0, 200


@dataclass(frozen=True, slots=True, eq=False)
class ChebyshevOrbit:
    """An orbit relative to a body; its velocity is the derivative of its position."""

    #: Beginning of the first record [TDB s past J2000].
    start_et: float
    #: Length of a record [s].
    record_s: float
    #: (n_records, n_coefficients, 3) coefficients [km].
    coefficients: Array

    @property
    def stop_et(self) -> float:
        """End of the last record [TDB s past J2000]."""
        return self.start_et + self.record_s * len(self.coefficients)


def write_orbit(path: Path, naif_id: int, orbit: ChebyshevOrbit, comment: str, near: int = MOON_ID) -> None:
    """Write an orbit as an SPK atomically, also while others write the same.

    Parameters
    ----------
    path : Path
        File to make or replace; its folder exists.
    naif_id : int
        Identifier of the object, by convention negative.
    orbit : ChebyshevOrbit
        Orbit relative to the Moon [km].
    comment : str
        Text for the comment area: where the orbit comes from.
    near : int
        Identifier of the body that the orbit is about.
    """
    with new_spk(path, comment) as handle:
        n_records, n_coefficients, _ = orbit.coefficients.shape
        spiceypy.spkw02(
            handle,
            naif_id,
            near,
            "J2000",
            orbit.start_et,
            orbit.stop_et,
            "coastarc orbit about the Moon" if near == MOON_ID else "coastarc orbit",
            orbit.record_s,
            n_records,
            n_coefficients - 1,
            orbit.coefficients.transpose(0, 2, 1).ravel(),
            orbit.start_et,
        )


@contextmanager
def new_spk(path: Path, comment: str) -> Iterator[int]:
    """Yield the handle of a new SPK, which is written atomically when the block ends.

    Parameters
    ----------
    path : Path
        File to make or replace; its folder exists.
    comment : str
        Text for the comment area, in ASCII.
    """
    # A name of its own for every writer; SPICE insists on making the file itself.
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".writing-") as folder:
        draft = Path(folder) / "draft.bsp"
        handle = spiceypy.spkopn(spice_name(draft), "coastarc", len(comment) + 1000)
        try:
            spiceypy.dafac(handle, comment.splitlines())
            yield handle
        except BaseException:
            # Else SPICE keeps the file open, and would refuse to close it as an SPK without segments.
            spiceypy.dafcls(handle)
            raise
        spiceypy.spkcls(handle)
        os.replace(draft, path)


def read_orbit(path: Path, naif_id: int, near: int = MOON_ID) -> ChebyshevOrbit | None:
    """Return the orbit of a kernel without loss, or None where it is not one run of records about a body.

    Parameters
    ----------
    path : Path
        An SPK.
    naif_id : int
        Identifier of the object.
    near : int
        That of the body.
    """
    found = [segment for segment in segments_of(path) if segment.body == naif_id]
    if len(found) != 1 or found[0][3:6] != (near, _J2000_FRAME, _CHEBYSHEV_POSITION):
        return None
    try:
        handle = spiceypy.dafopr(spice_name(path))
        try:
            words = np.array(spiceypy.dafgda(handle, found[0].first, found[0].last))
        finally:
            spiceypy.dafcls(handle)
    except SpiceyError as error:
        raise SpkError(f"target {path}: expected a readable SPK kernel, got {error.short}") from error
    start_et, record_s, width, n_records = words[-4:]
    records = words[:-4].reshape(round(n_records), round(width))
    if not np.all(np.isfinite(records)):
        raise SpkError(f"target {path}: expected finite coefficients, got some that are not; make it again")
    # Each record begins with its middle and its half length, by which SPICE goes, and not by the four words.
    middles = start_et + record_s * (np.arange(len(records)) + 0.5)
    is_regular = np.abs(records[:, 0] - middles) + np.abs(records[:, 1] - 0.5 * record_s) < _SAME_S
    stop_et = start_et + record_s * len(records)
    covers = start_et - _SAME_S <= found[0].start_et and found[0].stop_et <= stop_et + _SAME_S
    if not (np.all(is_regular) and covers):
        return None
    by_axis = records[:, 2:].reshape(round(n_records), 3, -1)
    return ChebyshevOrbit(float(start_et), float(record_s), np.ascontiguousarray(by_axis.transpose(0, 2, 1)))


def check_coverage(path: Path, naif_id: int, start_et: float, stop_et: float) -> None:
    """Check that a kernel holds an object throughout a span, in a frame that SPICE knows by itself.

    Parameters
    ----------
    path : Path
        An SPK.
    naif_id : int
        Identifier of the object.
    start_et, stop_et : float
        The span [TDB s past J2000].

    Raises
    ------
    SpkError
        When the file is not a sound SPK, lacks the object, or leaves out a part of the span.
    """
    segments = segments_of(path)
    present = sorted({segment.body for segment in segments})
    if (ours := [body for body in present if body in SOLAR_SYSTEM]) and not path.samefile(planetary_kernel()):
        raise SpkError(
            f"target {path}: expected no Sun, Earth, Moon or planets beside the target, since those of DE440 "
            f"hold, got {', '.join(map(str, ours))}; take the target out with NAIF's spkmerge"
        )
    own = [segment for segment in segments if segment.body == naif_id]
    if not own:
        raise SpkError(
            f"target {path}: expected an object {naif_id}, got {', '.join(map(str, present)) or 'none'}"
        )
    if other := [segment.frame for segment in own if segment.frame not in INERTIAL_FRAMES]:
        raise SpkError(
            f"target {path}: expected {naif_id} in a frame that is built into SPICE, like J2000, got frame "
            f"{other[0]}, which needs further kernels; write it in J2000"
        )
    covered = _merge_spans((segment.start_et, segment.stop_et) for segment in own)
    if not any(start <= start_et and stop_et <= stop for start, stop in covered):
        raise SpkError(
            f"target {path}: expected {naif_id} over {calendar_epoch(start_et)}..{calendar_epoch(stop_et)}, "
            f"got {_coverage_text(covered, start_et, stop_et)}"
        )


def _merge_spans(spans: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return sorted spans, with overlapping and adjacent ones merged."""
    joined: list[tuple[float, float]] = []
    for start, stop in sorted(spans):
        if joined and start <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(stop, joined[-1][1]))
        else:
            joined.append((start, stop))
    return joined


def _coverage_text(covered: list[tuple[float, float]], start_et: float, stop_et: float) -> str:
    """Return the coverage as text, or the first gap if the span has only gaps."""
    gaps = [(before[1], after[0]) for before, after in itertools.pairwise(covered)]
    inside = [(stop, start) for stop, start in gaps if stop < stop_et and start > start_et]
    if inside and covered[0][0] <= start_et and stop_et <= covered[-1][1]:
        return f"a gap over {calendar_epoch(inside[0][0])}..{calendar_epoch(inside[0][1])}"
    spans = [f"{calendar_epoch(start)}..{calendar_epoch(stop)}" for start, stop in covered]
    more = f" and {len(spans) - _MOST_SPANS} spans more" if len(spans) > _MOST_SPANS else ""
    return ", ".join(spans[:_MOST_SPANS]) + more


def fit_orbit(
    path: Path, naif_id: int, start_et: float, stop_et: float, near: int = MOON_ID
) -> ChebyshevOrbit:
    """Return the records through the positions that SPICE reads from any SPK, as long as they may be.

    Parameters
    ----------
    path, naif_id, start_et, stop_et
        As for `check_coverage`, which has passed.

    Raises
    ------
    SpkError
        When the orbit is too rough for the shortest records.
    """
    furnish(path)
    record_s = SECONDS_PER_DAY
    while record_s >= _SHORTEST_RECORD_S:
        # Whole records that end with the span, since SPICE may know nothing beyond it.
        n_records = math.ceil((stop_et - start_et) / record_s)
        length = (stop_et - start_et) / n_records
        nodes = record_nodes(start_et, length, n_records, _FIT_COEFFICIENTS)
        samples = [_position(path, naif_id, min(et, stop_et), near) for et in nodes.ravel().tolist()]
        coefficients = coefficients_through(np.array(samples).reshape(*nodes.shape, 3))
        # The last coefficients stand for those left out; T_n' is n^2 at the ends of a record.
        left_out = float(np.abs(coefficients[:, -2:]).max())
        left_out_rate = left_out * _FIT_COEFFICIENTS**2 / (0.5 * length)
        if left_out < _FIT_TOLERANCE_KM and left_out_rate < _FIT_TOLERANCE_KM_S:
            return ChebyshevOrbit(start_et, length, coefficients)
        record_s *= 0.5
    raise SpkError(
        f"target {path}: expected an orbit smooth to {_FIT_TOLERANCE_KM} km and {_FIT_TOLERANCE_KM_S} km/s "
        f"over {length:.0f} s, got {left_out:.1e} km and {left_out_rate:.1e} km/s"
    )


def _position(path: Path, naif_id: int, et: float, near: int) -> Array:
    try:
        return np.asarray(spiceypy.spkgps(naif_id, et, "J2000", near)[0], dtype=np.float64)
    except SpiceyError as error:
        raise SpkError(
            f"target {path}: expected {naif_id} about a centre whose way to the {_title(near)} is known at "
            f"{calendar_epoch(et)}, got {error.short}"
        ) from error


def _title(number: int) -> str:
    return next((body.title for body in BODIES.values() if body.naif_id == number), f"body {number}")


# What the process does that tries a kernel: the path of modules and the arguments stand in place of {}.
_TRIAL = "import sys; sys.path[:] = {}; from core.ephemeris.spk import try_out; try_out(*{})"
_REFUSED = 3


@functools.lru_cache(maxsize=8)
def orbit_of(
    path: Path,
    naif_id: int,
    start_et: float,
    stop_et: float,
    digest: str | None,
    near: int = MOON_ID,
    world: Path | None = None,
) -> ChebyshevOrbit:
    """Return the orbit of a kernel about a body, as its own records where they are about it, or fitted.

    SPICE looks at the file in a process of its own first: a damaged one can end the process that reads it.

    Parameters
    ----------
    path, naif_id, start_et, stop_et
        As for `check_coverage`, which has passed.
    digest : str or None
        That of the content: a file may be replaced by another one of the same name.
    near : int
        Identifier of the body.
    world : Path, optional
        A kernel with the places of the bodies, if they are not where DE440 has them.

    Raises
    ------
    SpkError
        When SPICE cannot read the file, or the orbit is too rough to be fitted.
    """
    arguments = (str(path), naif_id, start_et, stop_et, near, world and str(world))
    code = _TRIAL.format([str(folder) for folder in sys.path], arguments)
    try:
        command = [sys.executable, "-c", code]
        trial = subprocess.run(command, capture_output=True, timeout=_TRIAL_S, check=False)
    except subprocess.TimeoutExpired:
        raise SpkError(
            f"target {path}: expected an orbit that is read in {_TRIAL_S:.0f} s, got none by then; "
            f"make a kernel of longer records"
        ) from None
    if trial.returncode == _REFUSED:
        raise SpkError(trial.stderr.decode(errors="replace").strip().splitlines()[-1])
    if trial.returncode != 0:
        raise SpkError(
            f"target {path}: expected a kernel that SPICE can read, got exit code {trial.returncode} of the "
            f"process that tried; make or copy it again"
        )
    with np.load(io.BytesIO(trial.stdout), allow_pickle=False) as found:
        return ChebyshevOrbit(float(found["start_et"]), float(found["record_s"]), found["coefficients"])


def try_out(
    path: str, naif_id: int, start_et: float, stop_et: float, near: int, world: str | None = None
) -> None:
    """Read an orbit and write it to standard output, or one line of error; runs in a separate process.

    Parameters
    ----------
    path : str
        An SPK.
    naif_id : int
        Identifier of the object.
    start_et, stop_et : float
        The span [TDB s past J2000].
    near : int
        Identifier of the body that the orbit is about.
    world : str, optional
        A kernel with the places of the bodies.
    """
    try:
        if world is not None:
            furnish(Path(world))
        orbit = read_orbit(Path(path), naif_id, near)
        if orbit is None or orbit.coefficients.shape[1] < MIN_COEFFICIENTS:
            orbit = fit_orbit(Path(path), naif_id, start_et, stop_et, near)
        else:
            furnish(Path(path))
            for et in np.linspace(start_et, stop_et, _TRIED_EPOCHS).tolist():
                _position(Path(path), naif_id, et, near)
    except (SpkError, KernelError) as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(_REFUSED)
    except SpiceyError as error:
        sys.stderr.write(f"target {path}: expected a kernel that SPICE can read, got {error.short}\n")
        sys.exit(_REFUSED)
    np.savez(
        sys.stdout.buffer,
        start_et=orbit.start_et,
        record_s=orbit.record_s,
        coefficients=orbit.coefficients,
    )
