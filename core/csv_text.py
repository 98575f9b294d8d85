"""CSV as text, and cells that a spreadsheet must not compute."""

import csv
import io
from collections.abc import Iterable
from typing import Any

#: What a spreadsheet takes for the beginning of a formula.
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def csv_text(rows: Iterable[Iterable[Any]], line_end: str = "\n") -> str:
    """Return rows as CSV; None is empty, a float is written in full.

    Parameters
    ----------
    rows : iterable of iterable
        Cells of each line.
    line_end : str
        Use CR LF (RFC 4180) where a cell may hold a carriage return: with LF it would not be quoted.
    """
    written = io.StringIO()
    csv.writer(written, lineterminator=line_end).writerows(rows)
    return written.getvalue()


def without_formula(text: str) -> str:
    """Return an untrusted text for a cell, after an apostrophe if a spreadsheet would read it as a formula.

    Parameters
    ----------
    text : str
        Any text.
    """
    return f"'{text}" if text.startswith(_FORMULA) else text
