"""The Chebyshev records of DE440 as they stand in the file, for an integrator that takes polynomials.

Nothing here comes from `core.ephemeris.tables`, and SPICE evaluates nothing: it is asked for the words of the
file alone.  Frame: J2000 axes.  Units: km, TDB s past J2000.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
import spiceypy

from core.analysis.reflight import Array
from core.ephemeris.kernels import check_kernels, planetary_kernel

#: Target and centre of the runs of records that lead from the Earth to Moon, Sun and Jupiter: both Earth and
#: Moon are about their barycentre 3; that, the Sun and Jupiter's barycentre 5 are about the solar system's.
RUNS = ((399, 3), (301, 3), (3, 0), (10, 0), (5, 0))


class Record(NamedTuple):
    """A position as a polynomial of (et - middle) / radius, from -1 to 1."""

    middle: float
    radius: float
    #: (n_coefficients, 3) of T_0, T_1, ... [km].
    coefficients: Array


class Run(NamedTuple):
    """Successive records of one body relative to another, of one length."""

    start_et: float
    length: float
    #: (n_records, 2 + 3 n_coefficients): middle, radius, and the coefficients axis by axis.
    words: Array

    @property
    def n_coefficients(self) -> int:
        """Number of coefficients per axis."""
        return int((self.words.shape[1] - 2) // 3)

    def record_at(self, et: float) -> Record:
        """Return the record that holds from et on; at a boundary, the one that begins there."""
        middle, radius, *axes = self.words[int((et - self.start_et) // self.length)].tolist()
        return Record(middle, radius, np.array(axes).reshape(3, -1).T)


def read_runs(start_et: float, stop_et: float) -> tuple[Run, ...]:
    """Return the records of each of `RUNS` that touch a span.

    Parameters
    ----------
    start_et, stop_et : float
        The span [TDB s past J2000].
    """
    check_kernels()
    with _opened(str(planetary_kernel())) as handle:
        placed = {(target, centre): (first, last) for target, centre, first, last in _segments(handle)}
        return tuple(_run(handle, *placed[pair], start_et, stop_et) for pair in RUNS)


@contextmanager
def _opened(path: str) -> Iterator[int]:
    handle = spiceypy.dafopr(path)
    try:
        yield handle
    finally:
        spiceypy.dafcls(handle)


def _segments(handle: int) -> Iterator[tuple[int, int, int, int]]:
    """Yield target, centre, first and last address of every segment."""
    spiceypy.dafbfs(handle)
    while spiceypy.daffna():
        _, integers = spiceypy.dafus(spiceypy.dafgs(), 2, 6)
        target, centre, _, _, first, last = (int(number) for number in integers)
        yield target, centre, first, last


def _run(handle: int, first: int, last: int, start_et: float, stop_et: float) -> Run:
    # SPK type 2 ends with the beginning and the length of its records, their width, and their number.
    begin, length, width, n_records = spiceypy.dafgda(handle, last - 3, last)
    low, high = (min(int((et - begin) // length), int(n_records) - 1) for et in (start_et, stop_et))
    words = spiceypy.dafgda(handle, first + low * int(width), first + (high + 1) * int(width) - 1)
    return Run(float(begin + low * length), float(length), np.array(words).reshape(high + 1 - low, -1))
