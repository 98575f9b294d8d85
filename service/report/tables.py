"""Tables as data: rounded in the page, in full precision in the CSV file."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import floor, inf, isfinite, isnan, log10

from core.analysis.metrics import Estimate
from core.csv_text import csv_text, without_formula

Value = str | int | float | None
Cell = Value | Estimate

#: Shown for an unknown value.
NOTHING = "–"
#: Smaller p-values are shown as a bound.
P_LEAST = 0.0001
#: For `Column.decimals`: the digits of the source.
AS_GIVEN = -1


@dataclass(frozen=True, slots=True)
class Column:
    """A column: its head, its name in the CSV file, and the rounding of its numbers in the page."""

    head: str
    key: str
    #: Digits after the point; None for three significant ones, or AS_GIVEN.
    decimals: int | None = None
    #: Where published numbers come from, None for our own.
    source: str | None = None
    #: Whether its numbers are p-values, of which small ones must not read as zero.
    is_p: bool = False

    def text(self, cell: Cell) -> str:
        """Return a cell as text, without its interval."""
        if isinstance(cell, Estimate):
            return _number(cell.value, self.decimals)
        if isinstance(cell, float):
            if self.is_p and cell < P_LEAST:
                return f"< {P_LEAST}"
            return _number(cell, self.decimals)
        if isinstance(cell, int):
            return f"{cell:,}"
        return NOTHING if cell is None else str(cell)

    def interval(self, cell: Cell) -> str:
        """Return the interval of an estimate as text, empty for other cells."""
        if not isinstance(cell, Estimate) or isnan(cell.low):
            return ""
        # The ends are computed, whatever the value in the middle is.
        decimals = None if self.decimals == AS_GIVEN else self.decimals
        if cell.high == inf:
            return f"at least {_number(cell.low, decimals)}"
        return f"{_number(cell.low, decimals)} to {_number(cell.high, decimals)}"


def _number(value: float, decimals: int | None) -> str:
    if not isfinite(value):
        # A cost without a solution is infinite.
        return NOTHING
    if decimals == AS_GIVEN:
        text = f"{value:.6g}"
    else:
        text = significant(value) if decimals is None else f"{value:,.{decimals}f}"
    return text.replace("-", "−")


def significant(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits, without exponent, all integer digits kept."""
    if value == 0.0:
        return "0"
    decimals = digits - 1 - floor(log10(abs(value)))
    return f"{value:,.{max(0, decimals)}f}"


@dataclass(frozen=True, slots=True)
class Table:
    """Rows under columns, with a caption."""

    #: File name of the CSV, without its ending.
    name: str
    title: str
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]

    def __post_init__(self) -> None:
        """Raise ValueError where a row has another number of cells than there are columns."""
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"row of {self.name}: expected {len(self.columns)} cells, got {len(row)}")

    def is_text(self, column: int) -> bool:
        """Return whether a column holds text rather than numbers."""
        return any(isinstance(row[column], str) for row in self.rows)

    def as_csv(self) -> str:
        """Return the table as CSV, numbers in full, an estimate as three columns; empty where unknown."""
        return csv_text([self._keys(), *([_plain(value) for value in row] for row in self._values())])

    def as_records(self) -> list[dict[str, str | int | float | None]]:
        """Return the same as one record per row; what is unknown or infinite is None."""
        return [
            {key: _finite(value) for key, value in zip(self._keys(), row, strict=True)}
            for row in self._values()
        ]

    def _wide(self) -> list[bool]:
        """Return which columns hold estimates."""
        return [any(isinstance(row[i], Estimate) for row in self.rows) for i in range(len(self.columns))]

    def _keys(self) -> list[str]:
        keys = []
        for column, is_wide in zip(self.columns, self._wide(), strict=True):
            ends = (f"{column.key}_low", f"{column.key}_high") if is_wide else ()
            keys += [column.key, *ends]
        return keys

    def _values(self) -> Iterator[list[Value]]:
        wide = self._wide()
        for row in self.rows:
            values: list[Value] = []
            for cell, is_wide in zip(row, wide, strict=True):
                parts = [*cell] if isinstance(cell, Estimate) else [cell]
                values += [*parts, None, None] if is_wide and len(parts) == 1 else parts
            yield values


def _finite(value: Value) -> Value:
    return None if isinstance(value, float) and not isfinite(value) else value


def _plain(value: Value) -> Value:
    return without_formula(value) if isinstance(value, str) else _finite(value)
