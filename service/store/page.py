"""One page of a list of solutions: in which order, and from where on.

A page hangs on the values of the last item of the one before, so what arrives meanwhile neither repeats nor
hides anything.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from sqlalchemy import ColumnElement, and_, or_, select
from sqlalchemy.orm import Session

from service.db.tables import ProblemRow, SolutionRow
from service.store.errors import StoreError
from service.store.filter import Filter, Wanted

Sort = Literal[
    "objective_kg",
    "delta_v_km_s",
    "time_of_flight_days",
    "propellant_kg",
    "cpu_seconds",
    "k",
    "created_at",
]
#: Those of which the greatest are the most wanted.
DESCENDING: frozenset[Sort] = frozenset({"objective_kg", "created_at"})


@dataclass(frozen=True, slots=True)
class Order:
    """By what solutions are sorted; equal ones by their ids."""

    sort: Sort = "objective_kg"
    #: None is the way round that has the most wanted first.
    descending: bool | None = None

    @property
    def is_descending(self) -> bool:
        """Return which way round it is."""
        return self.sort in DESCENDING if self.descending is None else self.descending


@dataclass(frozen=True, slots=True)
class Begin:
    """Where a page begins: after the mark of another one, or at a value."""

    after: str | None = None
    value: float | None = None


def ids_of_page(
    session: Session, wanted: Filter, order: Order, begin: Begin, limit: int | None
) -> tuple[list[str], str | None]:
    """Return the ids on a page, and the mark after which the next one begins."""
    asked = Wanted(session, wanted)
    column = _column(asked, order.sort)
    query = select(SolutionRow.id, column).select_from(SolutionRow).where(*asked.conditions())
    if order.sort == "k":
        query = query.join(ProblemRow, ProblemRow.hash == SolutionRow.problem_hash)
    query = query.where(*_beginning(column, order, begin))
    sorted_by = column.desc() if order.is_descending else column
    most = None if limit is None else limit + 1
    rows = session.execute(query.order_by(sorted_by, SolutionRow.id).limit(most)).all()
    has_more = limit is not None and len(rows) > limit
    return [row[0] for row in rows[:limit]], _mark(rows, limit) if has_more else None


def _column(asked: Wanted, sort: Sort) -> Any:
    if sort == "cpu_seconds":
        return asked.first_cpu_seconds()
    return ProblemRow.k if sort == "k" else getattr(SolutionRow, sort)


def _beginning(column: Any, order: Order, begin: Begin) -> list[ColumnElement[bool]]:
    found = []
    if begin.value is not None:
        found.append(column <= begin.value if order.is_descending else column >= begin.value)
    if begin.after is not None:
        value, key = _read_mark(begin.after)
        is_further = column < value if order.is_descending else column > value
        found.append(or_(is_further, and_(column == value, SolutionRow.id > key)))
    return found


def _mark(rows: Sequence[Any], limit: int | None) -> str:
    assert limit is not None
    last = rows[limit - 1]
    # Hexadecimal keeps every bit of the float, which the next page's comparison needs.
    return f"{float(last[1]).hex()}_{last[0]}"


def _read_mark(text: str) -> tuple[float, str]:
    number, _, key = text.partition("_")
    try:
        return float.fromhex(number), key
    except (ValueError, OverflowError) as error:
        raise StoreError(f"after: expected the `next` of a page, got {text!r}") from error
