"""Solutions as lines of text: CSV for spreadsheets, NDJSON (one JSON object a line) for programs."""

import csv
import io
from collections.abc import Iterable, Iterator
from itertools import chain, islice
from typing import Any

from service.schemas.solution import Record, RecordWithVector

CSV = "text/csv"
NDJSON = "application/x-ndjson"

#: What has no place in a cell.
_NESTED = {"defects_solved", "defects_verified", "package_versions", "kernel_hashes"}
#: What a spreadsheet takes for the beginning of a formula.
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
COLUMNS = tuple(name for name in Record.model_fields if name not in _NESTED)


def csv_lines(pages: Iterable[list[RecordWithVector]]) -> Iterator[str]:
    """Yield the title line, then each page; outages are written 24:1.0 40:1.0, segment and days."""
    yield _table([COLUMNS])
    for page in pages:
        yield _table([_cell(getattr(record, name)) for name in COLUMNS] for record in page)


def ndjson_lines(pages: Iterable[list[RecordWithVector]]) -> Iterator[str]:
    """Yield each page, one record a line."""
    for page in pages:
        yield "".join(record.model_dump_json() + "\n" for record in page)


def begun(pieces: Iterator[str]) -> Iterator[str]:
    """Return the same pieces, the first of which is there: what fails before it can still be refused."""
    return chain(list(islice(pieces, 2)), pieces)


def _table(rows: Iterable[Iterable[Any]]) -> str:
    written = io.StringIO()
    # Lines end as RFC 4180 has it: with "\n" alone, a "\r" within a cell would be left unquoted.
    csv.writer(written, lineterminator="\r\n").writerows(rows)
    return written.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, list):
        return " ".join(f"{outage.segment}:{outage.duration_days}" for outage in value)
    if isinstance(value, str) and value.startswith(_FORMULA):
        # Names are harmless; what a worker says about itself may be anything.
        return f"'{value}"
    return value.isoformat() if hasattr(value, "isoformat") else value
