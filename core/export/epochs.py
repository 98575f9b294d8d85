"""Epochs as text: TDB to the microsecond, and the UTC of the leap seconds kernel."""

from collections.abc import Sequence

import numpy as np
import spiceypy
from numpy.typing import NDArray

from core.ephemeris.kernels import furnish, one_at_a_time


def tdb_texts(et: NDArray[np.float64]) -> list[str]:
    """Return TDB seconds past J2000 (n,) [s] as calendar epochs; their doubles are spaced by 1.2e-7 s."""
    origin = np.datetime64("2000-01-01T12:00:00", "us")
    return [str(origin + np.timedelta64(round(moment * 1e6), "us")) for moment in et.tolist()]


@one_at_a_time
def utc_texts(et: NDArray[np.float64]) -> Sequence[str]:
    """Return TDB seconds past J2000 (n,) [s] as UTC to the microsecond; later leap seconds are not known."""
    furnish()
    texts: list[str] = spiceypy.et2utc(et, "ISOC", 6).tolist()
    return texts
