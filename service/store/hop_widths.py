"""Step sizes of a chain, told from what became of its hops.

They are not stored: what `core.search.Chain` makes of its width follows from its moves alone.
"""

import math
from collections.abc import Iterable

from core.search.hopping import LEARNING_RATE, SUCCESS_SHARE, HopSettings


def widths(settings: HopSettings, told: Iterable[tuple[str | None, float | None]]) -> list[float | None]:
    """Return the width of each solve of a chain, from its first on; None where its guess was drawn afresh.

    Each is told by its move and by its violation, which is None where it was not finite.
    """
    found: list[float | None] = []
    width, is_hopping = settings.width, False
    for move, violation in told:
        found.append(width if is_hopping else None)
        if settings.adaptive and is_hopping:
            width = _learned(settings, width, move == "accepted")
        if move == "accepted":
            is_hopping = violation is not None
        elif move == "restarted":
            width, is_hopping = settings.width, False
    return found


def _learned(settings: HopSettings, width: float, has_won: bool) -> float:
    """Return the next width, docs/method.md eq. S14."""
    low, high = settings.width_range
    return min(max(width * math.exp(LEARNING_RATE * (has_won - SUCCESS_SHARE)), low), high)
