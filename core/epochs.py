"""TDB epochs: calendar text as users write it, and seconds past J2000 as SPICE counts them."""

import re
from typing import Annotated

from pydantic import AfterValidator

from core.constants import (
    KERNEL_SPAN,
)

_EPOCH = re.compile(r"(\d{4})-(\d\d)-(\d\d)T(\d\d):(\d\d):(\d\d)(?:\.(\d{1,6}))?", re.ASCII)


def _check_epoch(text: str) -> str:
    if not _EPOCH.fullmatch(text):
        raise ValueError("expected a TDB epoch YYYY-MM-DDTHH:MM:SS without zone")
    et = seconds_past_j2000(text)
    if not KERNEL_SPAN[0] < et < KERNEL_SPAN[1]:
        raise ValueError("expected an epoch inside the kernel DE440, 1549-12-31 to 2650-01-25")
    return text


def seconds_past_j2000(epoch: str) -> float:
    """Return a TDB calendar epoch as TDB seconds past J2000 (SPICE's ET)."""
    match = _EPOCH.fullmatch(epoch)
    if match is None:
        raise ValueError(f"expected a calendar epoch, got {epoch}")
    year, month, day, hour, minute, second = (int(part) for part in match.groups()[:6])
    n_days = _day_number(year, month + 1, 1) - _day_number(year, month, 1)
    if not (1 <= month <= 12 and 1 <= day <= n_days and hour < 24 and minute < 60 and second < 60):
        raise ValueError(f"expected a calendar epoch, got {epoch}")
    # Day numbers begin at noon, as J2000 does.
    days = _day_number(year, month, day) - _day_number(2000, 1, 1)
    seconds = 86400 * days + 3600 * (hour - 12) + 60 * minute + second
    return float(1_000_000 * seconds + int((match[7] or "0").ljust(6, "0"))) * 1e-6


def _day_number(year: int, month: int, day: int) -> int:
    """Return the Julian day number of a Gregorian date; month 13 is the next January."""
    # Years that begin in March end with the leap day.
    years, months = (year, month - 3) if month > 2 else (year - 1, month + 9)
    return 365 * years + years // 4 - years // 100 + years // 400 + (153 * months + 2) // 5 + day + 1721119


def calendar_epoch(et: float) -> str:
    """Return TDB seconds past J2000 [s] as a calendar epoch to the millisecond."""
    # Imported here: to read a problem needs no arrays.
    import numpy as np

    moment = np.datetime64("2000-01-01T12:00:00", "ms") + np.timedelta64(round(et * 1e3), "ms")
    return str(moment)


Epoch = Annotated[str, AfterValidator(_check_epoch)]
