"""Orbits as SPK kernels, in Chebyshev records of one length (SPK type 2), and checks of users' kernels.

Frame: J2000 axes, origin at the Moon or another body.  Units: km, TDB s past J2000.

A user's kernel is read in three steps: `core.ephemeris.daf` validates its bytes, `orbit_of` runs all later
SPICE calls in a separate process, and only then it is loaded into this one.  `check_world` does both for a
kernel with the bodies of a world.
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
from core.ephemeris.daf import INERTIAL_FRAMES, Segment, SpkError, is_finite, segments_of
from core.ephemeris.kernels import KernelError, furnish, loaded, planetary_kernel, spice_name
from core.ephemeris.tables import MIN_COEFFICIENTS, coefficients_through, fine_record_days, record_nodes
from core.epochs import calendar_epoch
from core.plain_data import file_digest
from core.world import BODIES, EARTH, World

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
# Spans of a kernel that a message lists, and pairs of bodies.
_MOST_SPANS, _MOST_PAIRS = 3, 8
# How long a kernel may be tried [s], and at how many epochs where nothing is fitted.
_TRIAL_S, _TRIED_EPOCHS = 300.0, 200
# How much farther or nearer than in DE440 a body of a world's kernel may be: less than metres for km.
_MOST_TIMES_AWAY = 100.0


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


# What the process does that tries a kernel: path of modules, function and arguments stand in place of {}.
_TRIAL = "import sys; sys.path[:] = {}; from core.ephemeris import spk; spk.{}(*{})"
_REFUSED = 3


def _tried(named: str, function: str, *arguments: object) -> bytes:
    """Return what a function of this file writes to standard output in a process of its own.

    A damaged file can end the process in which SPICE reads it.
    """
    code = _TRIAL.format([str(folder) for folder in sys.path], function, arguments)
    try:
        command = [sys.executable, "-c", code]
        trial = subprocess.run(command, capture_output=True, timeout=_TRIAL_S, check=False)
    except subprocess.TimeoutExpired:
        raise SpkError(
            f"{named}: expected an orbit that is read in {_TRIAL_S:.0f} s, got none by then; "
            f"make a kernel of longer records"
        ) from None
    if trial.returncode == _REFUSED:
        raise SpkError(trial.stderr.decode(errors="replace").strip().splitlines()[-1])
    if trial.returncode != 0:
        raise SpkError(
            f"{named}: expected a kernel that SPICE can read, got exit code {trial.returncode} of the "
            f"process that tried; make or copy it again"
        )
    return trial.stdout


@contextmanager
def _refusing(named: str) -> Iterator[None]:
    """End this process, which tries a kernel, with one line where the kernel is refused."""
    try:
        yield
    except (SpkError, KernelError) as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(_REFUSED)
    except SpiceyError as error:
        sys.stderr.write(f"{named}: expected a kernel that SPICE can read, got {error.short}\n")
        sys.exit(_REFUSED)


@functools.lru_cache(maxsize=8)
def orbit_of(
    path: Path, naif_id: int, start_et: float, stop_et: float, digest: str | None, world: World = EARTH
) -> ChebyshevOrbit:
    """Return the orbit of a kernel about a world's body, as its own records where so they are, or fitted.

    Parameters
    ----------
    path, naif_id, start_et, stop_et
        As for `check_coverage`, which has passed.
    digest : str or None
        That of the content: a file may be replaced by another one of the same name.
    world : World
        The orbit is about `World.near`, with the bodies where the world has them.

    Raises
    ------
    SpkError
        When SPICE cannot read the file, or the orbit is too rough to be fitted.
    """
    arguments = (str(path), naif_id, start_et, stop_et, world.near.naif_id)
    written = _tried(f"target {path}", "try_out", *arguments, world.kernel and str(world.kernel))
    with np.load(io.BytesIO(written), allow_pickle=False) as found:
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
    with _refusing(f"target {path}"):
        if world is not None:
            furnish(Path(world))
        orbit = read_orbit(Path(path), naif_id, near)
        if orbit is None or orbit.coefficients.shape[1] < MIN_COEFFICIENTS:
            orbit = fit_orbit(Path(path), naif_id, start_et, stop_et, near)
        else:
            furnish(Path(path))
            for et in np.linspace(start_et, stop_et, _TRIED_EPOCHS).tolist():
                _position(Path(path), naif_id, et, near)
    np.savez(
        sys.stdout.buffer,
        start_et=orbit.start_et,
        record_s=orbit.record_s,
        coefficients=orbit.coefficients,
    )


def check_world(world: World, start_et: float, stop_et: float) -> None:
    """Check that the kernel of a world, if it has one, has all its bodies throughout a span.

    Parameters
    ----------
    world : World
        Its kernel, its centre and its bodies.
    start_et, stop_et : float
        The span [TDB s past J2000].

    Raises
    ------
    SpkError
        When the file is not a sound SPK, has been changed, lacks a body or a part of the span, or places
        bodies where they cannot be.
    KernelError
        When SPICE cannot hold its path.
    """
    if world.kernel is None:
        return
    spice_name(world.kernel)
    try:
        digest = file_digest(world.kernel)
    except OSError as error:
        raise SpkError(f"{_role(world)}: expected a readable SPK kernel, got {error.strerror}") from error
    if world.digest not in (None, digest):
        raise SpkError(
            f"{_role(world)}: expected the file with digest {world.digest}, got {digest}; "
            f"it has been changed since"
        )
    _check_content(world, digest, start_et, stop_et)


def bodies_of(kernel: Path) -> frozenset[int]:
    """Return the identifiers of what a kernel that `check_world` has passed holds."""
    return frozenset(segment.body for segment in segments_of(kernel, "world.kernel"))


def _role(world: World) -> str:
    return f"world.kernel {world.kernel}"


@functools.lru_cache(maxsize=64)
def _check_content(world: World, digest: str, start_et: float, stop_et: float) -> None:
    assert world.kernel is not None
    segments, named, centre = segments_of(world.kernel, "world.kernel"), _role(world), world.center
    from_center = _ways(segments, centre.naif_id)
    for body in world.bodies:
        ways = _ways(segments, body.naif_id)
        shared = ways.keys() & from_center.keys()
        covered = _merge_spans(span for node in shared for span in _common(ways[node], from_center[node]))
        about = f"{body.name} ({body.naif_id}) relative to {centre.name} ({centre.naif_id})"
        if not covered:
            pairs = sorted({(segment.body, segment.centre) for segment in segments})[:_MOST_PAIRS]
            listed = ", ".join(f"{one} relative to {other}" for one, other in pairs) or "nothing"
            raise SpkError(
                f"{named}: expected {about}, got {listed}; write it into the kernel, or leave it out of "
                f"world.bodies"
            )
        if not any(start <= start_et and stop_et <= stop for start, stop in covered):
            raise SpkError(
                f"{named}: expected {about} from the departure to the latest arrival, "
                f"{calendar_epoch(start_et)}..{calendar_epoch(stop_et)}, got "
                f"{_coverage_text(covered, start_et, stop_et)}; make it longer, or narrow bounds"
            )
        for segment in (one for one in segments if one.body in ways.keys() | from_center.keys()):
            _check_segment(named, world.kernel, segment)
    bodies = tuple((body.naif_id, body.name) for body in world.bodies)
    record_s = fine_record_days(world) * SECONDS_PER_DAY
    arguments = (str(world.kernel), centre.naif_id, bodies, start_et, stop_et)
    _tried(named, "try_world", *arguments, record_s, world.strict.position_km)


def _check_segment(named: str, kernel: Path, segment: Segment) -> None:
    if segment.frame not in INERTIAL_FRAMES:
        raise SpkError(
            f"{named}: expected {segment.body} in a frame that is built into SPICE, like J2000, got frame "
            f"{segment.frame}, which needs further kernels; write it in J2000"
        )
    if not is_finite(kernel, segment):
        raise SpkError(
            f"{named}: expected finite numbers for {segment.body}, got NaN or infinity; make it again"
        )


def _ways(segments: Iterable[Segment], number: int) -> dict[int, list[tuple[float, float]]]:
    """Return when a body's place relative to each other body follows from segments, by that body."""
    own: dict[int, list[Segment]] = {}
    for segment in segments:
        own.setdefault(segment.body, []).append(segment)
    ways = {number: [(-math.inf, math.inf)]}
    ends = ways.copy()
    for _ in own:
        further: dict[int, list[tuple[float, float]]] = {}
        for node, spans in ends.items():
            for one in own.get(node, ()):
                further.setdefault(one.centre, []).extend(_common(spans, [(one.start_et, one.stop_et)]))
        ends = {node: _merge_spans(spans) for node, spans in further.items() if spans}
        for node, spans in ends.items():
            ways[node] = _merge_spans([*ways.get(node, []), *spans])
    return ways


def _common(
    some: Iterable[tuple[float, float]], others: Iterable[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Return the spans that are in one of some and in one of others."""
    pairs = itertools.product(some, others)
    cut = [(max(one[0], other[0]), min(one[1], other[1])) for one, other in pairs]
    return [span for span in cut if span[0] < span[1]]


def try_world(
    path: str,
    center: int,
    bodies: tuple[tuple[int, str], ...],
    start_et: float,
    stop_et: float,
    record_s: float,
    tolerance_km: float,
) -> None:
    """Compare the places of a world's bodies with DE440 and with polynomials; runs in a separate process.

    Parameters
    ----------
    path : str
        An SPK with all of the bodies.
    center : int
        Identifier of the centre.
    bodies : tuple of (int, str)
        Identifier and name of each body.
    start_et, stop_et : float
        The span [TDB s past J2000].
    record_s : float
        Length of the records by which the bodies are known to the solver [s].
    tolerance_km : float
        How far a body may be from such a record [km].
    """
    named = f"world.kernel {path}"
    with _refusing(named):
        furnish()
        length = min(record_s, stop_et - start_et)
        begins = np.linspace(start_et, stop_et - length, _TRIED_EPOCHS)
        nodes = np.array([record_nodes(begin, length, 1, MIN_COEFFICIENTS)[0] for begin in begins])
        between = begins[:, None] + length * np.array([0.02, 0.5, 0.98])
        for number, name in bodies:
            usual = np.linalg.norm(_places(number, begins, center), axis=-1)
            with loaded(Path(path)):
                places, further = (_places(number, epochs, center) for epochs in (nodes, between))
            _require_near(named, name, places[:, 0], usual, begins)
            fitted = np.polynomial.chebyshev.chebval(
                [-0.96, 0.0, 0.96], coefficients_through(places).transpose(1, 0, 2)
            )
            rough = np.linalg.norm(fitted.transpose(0, 2, 1) - further, axis=-1).max(axis=1)
            worst = int(np.argmax(rough))
            if not rough[worst] <= tolerance_km:
                raise SpkError(
                    f"{named}: expected {name} on a path that is smooth to {tolerance_km:g} km over "
                    f"{length / SECONDS_PER_DAY:g} days, got {rough[worst]:.3g} km at "
                    f"{calendar_epoch(float(begins[worst]))}; make it again, of more points"
                )


def _places(number: int, epochs: Array, center: int) -> Array:
    """Return positions (*epochs.shape, 3) [km] of a body relative to a centre, as SPICE has them now."""
    found = [spiceypy.spkgps(number, et, "J2000", center)[0] for et in epochs.ravel().tolist()]
    return np.array(found).reshape(*epochs.shape, 3)


def _require_near(named: str, name: str, places_km: Array, usual_km: Array, epochs: Array) -> None:
    distances = np.linalg.norm(places_km, axis=-1)
    low, high = usual_km / _MOST_TIMES_AWAY, usual_km * _MOST_TIMES_AWAY
    if np.any(outside := ~((low <= distances) & (distances <= high))):
        first = int(np.argmax(outside))
        raise SpkError(
            f"{named}: expected {name} {low[first]:.3g} to {high[first]:.3g} km from the centre, got "
            f"{distances[first]:.3g} km at {calendar_epoch(float(epochs[first]))}; in metres or other units?"
        )
