"""Orbits about the Moon as SPK kernels, in Chebyshev records of one length (SPK type 2).

Frame: J2000 axes, origin at the Moon.  Units: km, TDB s past J2000.

    SpkError(RuntimeError)   a kernel that does not hold what is asked of it
"""

import math
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import spiceypy
from numpy.typing import NDArray
from spiceypy.utils.exceptions import SpiceyError

from core.constants import SECONDS_PER_DAY
from core.ephemeris.kernels import furnish, planetary_kernel
from core.ephemeris.tables import coefficients_through, record_nodes
from core.problem import calendar_epoch

Array = NDArray[np.float64]

MOON_ID = 301
#: What DE440 holds: barycentres of planets, the Sun, Mercury, Venus, the Moon and the Earth.
SOLAR_SYSTEM = frozenset({*range(11), 199, 299, MOON_ID, 399})
_J2000_FRAME, _CHEBYSHEV_POSITION = 1, 2

# Of a fit to a given kernel.  SPICE's epochs are spaced by 1e-7 s, which the rates feel most.
_FIT_TOLERANCE_KM, _FIT_TOLERANCE_KM_S = 1e-4, 1e-7
_FIT_COEFFICIENTS = 16
_SHORTEST_RECORD_S = 600.0


class SpkError(RuntimeError):
    """A kernel that does not hold what is asked of it."""


@dataclass(frozen=True, slots=True, eq=False)
class ChebyshevOrbit:
    """An orbit relative to the Moon; its velocity is the derivative of its position."""

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


def write_orbit(path: Path, naif_id: int, orbit: ChebyshevOrbit, comment: str) -> None:
    """Write an orbit as an SPK that appears whole or not at all, also while others write the same.

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
    """
    with new_spk(path, comment) as handle:
        n_records, n_coefficients, _ = orbit.coefficients.shape
        spiceypy.spkw02(
            handle,
            naif_id,
            MOON_ID,
            "J2000",
            orbit.start_et,
            orbit.stop_et,
            "coastarc orbit about the Moon",
            orbit.record_s,
            n_records,
            n_coefficients - 1,
            orbit.coefficients.transpose(0, 2, 1).ravel(),
            orbit.start_et,
        )


@contextmanager
def new_spk(path: Path, comment: str) -> Iterator[int]:
    """Give the handle of a new SPK; the file appears when the block ends, or not at all.

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
        handle = spiceypy.spkopn(str(draft), "coastarc", len(comment) + 1000)
        try:
            spiceypy.dafac(handle, comment.splitlines())
            yield handle
        except BaseException:
            # Else SPICE keeps the file open, and would refuse to close it as an SPK without segments.
            spiceypy.dafcls(handle)
            raise
        spiceypy.spkcls(handle)
        os.replace(draft, path)


def read_orbit(path: Path, naif_id: int) -> ChebyshevOrbit | None:
    """Return the orbit of a kernel without loss, or None where it is not one run of records about the Moon.

    Parameters
    ----------
    path : Path
        An SPK.
    naif_id : int
        Identifier of the object.
    """
    with _opened(path) as handle:
        found = [summary for summary in _summaries(handle) if summary[0] == naif_id]
        if len(found) != 1 or found[0][1:4] != (MOON_ID, _J2000_FRAME, _CHEBYSHEV_POSITION):
            return None
        first, last = found[0][4:]
        words = np.array(spiceypy.dafgda(handle, first, last))
    start_et, record_s, width, n_records = words[-4:]
    records = words[:-4].reshape(round(n_records), round(width))
    # Each record begins with its middle and its half length.
    by_axis = records[:, 2:].reshape(round(n_records), 3, -1)
    return ChebyshevOrbit(float(start_et), float(record_s), np.ascontiguousarray(by_axis.transpose(0, 2, 1)))


def check_coverage(path: Path, naif_id: int, start_et: float, stop_et: float) -> None:
    """Check that a kernel holds an object throughout a span.

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
        When the file is not an SPK, lacks the object, or leaves out a part of the span.
    """
    with _opened(path) as handle:
        present = sorted({summary[0] for summary in _summaries(handle)})
    if (ours := [body for body in present if body in SOLAR_SYSTEM]) and not path.samefile(planetary_kernel()):
        raise SpkError(
            f"target {path}: expected no Sun, Earth, Moon or planets beside the target, since those of DE440 "
            f"hold, got {', '.join(map(str, ours))}; take the target out with NAIF's spkmerge"
        )
    if naif_id not in present:
        raise SpkError(f"target {path}: expected an object {naif_id}, got {', '.join(map(str, present))}")
    covered = spiceypy.spkcov(str(path), naif_id)
    if not spiceypy.wnincd(start_et, stop_et, covered):
        spans = [spiceypy.wnfetd(covered, i) for i in range(spiceypy.wncard(covered))]
        shown = ", ".join(f"{calendar_epoch(start)}..{calendar_epoch(stop)}" for start, stop in spans)
        raise SpkError(
            f"target {path}: expected {naif_id} over {calendar_epoch(start_et)}..{calendar_epoch(stop_et)}, "
            f"got {shown}"
        )


def fit_orbit(path: Path, naif_id: int, start_et: float, stop_et: float) -> ChebyshevOrbit:
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
        samples = [_position(path, naif_id, min(et, stop_et)) for et in nodes.ravel().tolist()]
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


def _position(path: Path, naif_id: int, et: float) -> Array:
    try:
        return np.asarray(spiceypy.spkgps(naif_id, et, "J2000", MOON_ID)[0], dtype=np.float64)
    except SpiceyError as error:
        raise SpkError(
            f"target {path}: expected {naif_id} about a centre whose way to the Moon is known at "
            f"{calendar_epoch(et)}, got {error.short}"
        ) from error


@contextmanager
def _opened(path: Path) -> Iterator[int]:
    try:
        kind = spiceypy.getfat(str(path))
        if kind != ("DAF", "SPK"):
            raise SpkError(f"target {path}: expected an SPK kernel, got a file of kind {'/'.join(kind)}")
        handle = spiceypy.dafopr(str(path))
    except SpiceyError as error:
        raise SpkError(f"target {path}: expected a readable SPK kernel, got {error.short}") from error
    try:
        yield handle
    finally:
        spiceypy.dafcls(handle)


def _summaries(handle: int) -> Iterator[tuple[int, ...]]:
    """Yield target, centre, frame, type, first and last address of every segment."""
    spiceypy.dafbfs(handle)
    while spiceypy.daffna():
        _, integers = spiceypy.dafus(spiceypy.dafgs(), 2, 6)
        yield tuple(int(number) for number in integers)
