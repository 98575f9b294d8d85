"""Validation of a user's SPK as bytes, before SPICE, which does not check a file, reads it.

A DAF consists of records of 1024 bytes: the first describes the layout of the file, a linked list of others
the segments, each with two epochs and six integers.  Words of 8 bytes are addressed from 1.  Epochs: TDB s
past J2000.

    SpkError(UserError, RuntimeError)   an invalid kernel, or one without the requested data
"""

import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.errors import UserError

_RECORD, _WORD = 1024, 8
_WORDS_OF_RECORD = _RECORD // _WORD
_MOST_SUMMARIES = 25
_BYTE_ORDERS = {b"LTL-IEEE": "<", b"BIG-IEEE": ">"}
#: Types of segments that the reader of SPICE N0067 knows.
TYPES = frozenset({1, 2, 3, 5, 8, 9, 10, 12, 13, 14, 15, 17, 18, 19, 20, 21})
#: The inertial frames that are built into SPICE: J2000 is 1, the ecliptic of J2000 is 17.
INERTIAL_FRAMES = range(1, 22)
# SPICE reads a record into room for so many words, and interpolates up to this degree.
_LONGEST_RECORD, _HIGHEST_DEGREE = 197, 27


class SpkError(UserError, RuntimeError):
    """An invalid kernel, or one without the requested data."""


class Segment(NamedTuple):
    """The summary of a segment."""

    start_et: float
    stop_et: float
    body: int
    centre: int
    frame: int
    #: SPK type: how positions are stored.
    kind: int
    #: Addresses of its first and its last word.
    first: int
    last: int


def segments_of(path: Path, role: str = "target") -> tuple[Segment, ...]:
    """Return the segments of an SPK in order, each checked to lie in the file and to have its stated length.

    Parameters
    ----------
    path : Path
        A file that may be anything.
    role : str
        What messages call it.

    Raises
    ------
    SpkError
        When it is no SPK, is cut off, or contradicts itself.
    """
    named = f"{role} {path}"
    try:
        # A pipe would wait for a writer when it is opened.
        if not stat.S_ISREG(path.stat().st_mode):
            raise SpkError(f"{named}: expected an SPK file, got no regular file")
        with path.open("rb") as stream:
            return tuple(_segments(named, stream))
    except OSError as error:
        raise SpkError(f"{named}: expected a readable SPK kernel, got {error.strerror}") from error


def _segments(named: str, stream: BinaryIO) -> Iterator[Segment]:
    head = stream.read(_RECORD)
    order = _byte_order(named, head)
    n_words = os.fstat(stream.fileno()).st_size // _WORD
    fward, _, free = _integers(head, order, 76, 3)
    if free - 1 > n_words:
        expected = f"a whole SPK kernel of {_WORD * (free - 1)} bytes"
        raise SpkError(f"{named}: expected {expected}, got {_WORD * n_words}; copy it again")
    seen: set[int] = set()
    place = fward
    while place != 0:
        if place in seen or not 1 < place <= n_words // _WORDS_OF_RECORD:
            raise _corrupt_error(named, f"a list of segments that leads to record {place}")
        seen.add(place)
        words = _words(stream, order, (place - 1) * _WORDS_OF_RECORD + 1, _WORDS_OF_RECORD)
        following, _, n_summaries = words[:3].tolist()
        if not (_is_count(n_summaries, _MOST_SUMMARIES) and _is_count(following, n_words)):
            raise _corrupt_error(
                named, f"{n_summaries:g} segments in record {place}, and {following:g} as the next"
            )
        for n in range(int(n_summaries)):
            row = words[3 + 5 * n : 8 + 5 * n]
            segment = Segment(*row[:2].tolist(), *row[2:].copy().view(f"{order}i4").tolist())
            _check(named, stream, order, segment, n_words)
            yield segment
        place = int(following)


def is_finite(path: Path, segment: Segment) -> bool:
    """Return whether all words of a segment from `segments_of` are finite numbers.

    Parameters
    ----------
    path : Path
        Its file.
    segment : Segment
        Of any type: each keeps its counts as numbers, too.
    """
    with path.open("rb") as stream:
        order = _byte_order(str(path), stream.read(_RECORD))
        return bool(
            np.all(np.isfinite(_words(stream, order, segment.first, segment.last - segment.first + 1)))
        )


def _byte_order(named: str, head: bytes) -> str:
    name = head[:8]
    if name.startswith(b"DAFETF") or name.startswith(b"DASETF"):
        raise SpkError(
            f"{named}: expected an SPK kernel, got one in transfer format; make it binary with NAIF's tobin"
        )
    if name not in (b"DAF/SPK ", b"NAIF/DAF"):
        kind = "empty" if not head else repr(name.decode("ascii", "replace").strip("\0 \r\n"))
        raise SpkError(f"{named}: expected an SPK kernel, got a file of kind {kind}")
    order = _BYTE_ORDERS.get(head[88:96])
    if len(head) < _RECORD or order is None or _integers(head, order, 8, 2) != [2, 6]:
        raise _corrupt_error(
            named, f"a first record with the format {head[88:96].decode('ascii', 'replace')!r}"
        )
    return order


def _check(named: str, stream: BinaryIO, order: str, segment: Segment, n_words: int) -> None:
    """Check that a segment lies in the file, is of a known type, and is as long as its own counts say."""
    part = f"a segment of {segment.body}, type {segment.kind},"
    if not -np.inf < segment.start_et <= segment.stop_et < np.inf:
        raise _corrupt_error(named, f"{part} from {segment.start_et} to {segment.stop_et} s")
    if not _WORDS_OF_RECORD < segment.first <= segment.last <= n_words:
        raise _corrupt_error(named, f"{part} at words {segment.first} to {segment.last} of {n_words}")
    if segment.kind not in TYPES:
        raise SpkError(f"{named}: expected segments of types that SPICE reads, got type {segment.kind}")
    n_own = segment.last - segment.first + 1
    tail = _words(stream, order, max(segment.first, segment.last - 3), min(4, n_own))
    if len(tail) == 4 and not _fits(segment.kind, n_own, *tail.tolist()):
        raise _corrupt_error(named, f"{part} of {n_own} words that ask for another number")
    if segment.kind in (5, 9, 13):
        n = int(tail[3])
        epochs, again = np.split(_words(stream, order, segment.first + 6 * n, n + (n - 1) // 100), [n])
        if not (np.all(np.isfinite(epochs)) and np.all(np.diff(epochs) > 0)):
            raise _corrupt_error(named, f"{part} whose epochs do not rise")
        if not np.array_equal(epochs[99::100][: len(again)], again):
            raise _corrupt_error(named, f"{part} whose directory lists other epochs")


def _fits(kind: int, n_own: int, begin: float, length: float, third: float, last: float) -> bool:
    """Return whether the last four words of a segment fit its length, where its type has counts there."""
    if kind in (2, 3):
        # Each record: middle, radius, and as many coefficients of every component.
        n_components = 3 * (kind - 1)
        return (
            _is_count(third, _LONGEST_RECORD)
            and third > 2
            and (third - 2) % n_components == 0
            and 0 < length < np.inf
            and abs(begin) < np.inf
            and third * last + 4 == n_own
        )
    if kind in (8, 12):
        return 0 < length < np.inf and _is_count(third, _HIGHEST_DEGREE) and 6 * last + 4 == n_own
    if kind in (5, 9, 13):
        # States, epochs, every hundredth epoch again, and two words more.
        is_whole = _is_count(last, n_own) and last >= 1 and 7 * last + (last - 1) // 100 + 2 == n_own
        return is_whole and (kind == 5 or _is_count(third, _HIGHEST_DEGREE))
    return True


def _is_count(value: float, most: float) -> bool:
    return 0 <= value <= most and value == int(value)


def _integers(head: bytes, order: str, place: int, number: int) -> list[int]:
    numbers: list[int] = np.frombuffer(head, f"{order}i4", number, offset=place).tolist()
    return numbers


def _words(stream: BinaryIO, order: str, address: int, number: int) -> NDArray[np.float64]:
    stream.seek(_WORD * (address - 1))
    return np.frombuffer(stream.read(_WORD * number), f"{order}f8")


def _corrupt_error(named: str, found: str) -> SpkError:
    return SpkError(f"{named}: expected a sound SPK kernel, got {found}; make or copy it again")
