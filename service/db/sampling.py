"""Rows chosen evenly by their ids, the same ones each time."""

from typing import Any

#: 2^32 divided by the golden ratio: multiples of it, modulo 2^32, are spread evenly, whatever goes round in
#: the ids, as cases and workers do.
STEP = 2654435761
SPAN = 2**32


def mixed(column: Any) -> Any:
    """Return an expression whose values lie evenly in [0, SPAN), and that both databases compute alike."""
    # Below 2^31, the product fits into 64 bits.
    return (column % 2**31) * STEP % SPAN


def is_drawn(column: Any, wanted: int, of: int) -> Any:
    """Return the condition that about `wanted` of so many rows meet."""
    return mixed(column) < SPAN * wanted // max(of, 1)
