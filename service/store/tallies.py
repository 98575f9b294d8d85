"""Counts of rows that only grow in number, kept per search in the transaction that adds the rows.

| of       | by                                                            |
|----------|---------------------------------------------------------------|
| attempt  | ending                                                        |
| job      | `done` alone: the others are few, or what is left             |
| solve    | ending, with processor time                                   |
| status   | status of a solve                                             |
| level    | `paper`, `strict`: solves that reach it                       |
| solution | where nobody had found it before: see `scope_of`              |
| strict   | the same, of solutions that are strict                        |
"""

from collections import Counter, defaultdict
from collections.abc import Iterable
from functools import cache
from typing import Any

from sqlalchemy import ColumnElement, bindparam, case, func, literal_column, select
from sqlalchemy.orm import Session

from service.db.dialect import INSERTS, plain
from service.db.tables import JobRow, SearchRow, SolveRow, TallyRow
from service.db.transitions import ENDED

#: Of one search by (noun, name).
Key = tuple[str, str]
#: A solution that is new to the archive is new to its campaign and its search too, and so on.
SCOPES = ("archive", "campaign", "search")

_TALLY = plain(TallyRow)
_SOLVE = plain(SolveRow).c
_SEARCH = plain(SearchRow).c
_FINDERS = (
    select(_SOLVE.search_id, _SEARCH.campaign_id)
    .join(plain(SearchRow), _SEARCH.id == _SOLVE.search_id)
    .where(_SOLVE.solution_id == bindparam("solution_id"))
    .distinct()
)


class Counts:
    """What is to be added to tallies."""

    def __init__(self) -> None:
        self._numbers: Counter[tuple[int, str, str]] = Counter()
        self._seconds: defaultdict[tuple[int, str, str], float] = defaultdict(float)

    def add(self, search_id: int, noun: str, name: str, cpu_seconds: float = 0.0, *, number: int = 1) -> None:
        """Count one, or what is said."""
        self._numbers[search_id, noun, name] += number
        self._seconds[search_id, noun, name] += cpu_seconds

    def store(self, session: Session) -> None:
        """Add all of it to the tallies, in an order that is the same for everybody."""
        if not self._numbers:
            return
        rows = [
            dict(zip(("search_id", "noun", "name"), key, strict=True))
            | {"number": number, "cpu_seconds": self._seconds[key]}
            for key, number in sorted(self._numbers.items())
        ]
        connection = session.connection()
        connection.execute(_addition(connection.dialect.name), rows)


@cache
def _addition(dialect: str) -> Any:
    statement = INSERTS[dialect](_TALLY)
    columns, more = _TALLY.c, statement.excluded
    return statement.on_conflict_do_update(
        index_elements=list(_TALLY.primary_key),
        set_={
            "number": columns.number + more.number,
            "cpu_seconds": columns.cpu_seconds + more.cpu_seconds,
        },
    )


def scope_of(session: Session, solution_id: str, search_id: int, campaign_id: int) -> str | None:
    """Return the widest of the scopes in which nobody has found a solution yet, or None if all know it."""
    finders = session.connection().execute(_FINDERS, {"solution_id": solution_id}).all()
    if not finders:
        return "archive"
    if all(campaign != campaign_id for _, campaign in finders):
        return "campaign"
    return None if search_id in {search for search, _ in finders} else "search"


def tallies(session: Session, wanted: ColumnElement[bool]) -> dict[int, dict[str, dict[str, int]]]:
    """Return the numbers of some searches: by search, noun and name."""
    query = (
        select(TallyRow.search_id, TallyRow.noun, TallyRow.name, TallyRow.number)
        .join(SearchRow, SearchRow.id == TallyRow.search_id)
        .where(wanted)
        .order_by(TallyRow.search_id, TallyRow.noun, TallyRow.name)
    )
    found: dict[int, dict[str, dict[str, int]]] = defaultdict(lambda: defaultdict(dict))
    for search_id, noun, name, number in session.execute(query):
        found[search_id][noun][name] = number
    return found


def totals(session: Session, noun: str) -> dict[str, tuple[int, float]]:
    """Return the numbers and processor times [s] of the whole archive by name."""
    query = (
        select(TallyRow.name, func.sum(TallyRow.number), func.sum(TallyRow.cpu_seconds))
        .where(TallyRow.noun == noun)
        .group_by(TallyRow.name)
    )
    return {name: (int(number), seconds) for name, number, seconds in session.execute(query)}


def n_solutions(counted: dict[str, int], scope: str) -> int:
    """Return how many different solutions were found within a scope, from what its searches tell."""
    return sum(counted.get(name, 0) for name in SCOPES[: SCOPES.index(scope) + 1])


#: The state of most jobs that have not run: counted as what is left, since nothing bounds their number.
_LEFT = case((SearchRow.state.in_(ENDED), "cancelled"), else_="queued")
_FEW = case((SearchRow.state.in_(ENDED), literal_column("'queued'")), else_=literal_column("'cancelled'"))


def job_states(session: Session, wanted: ColumnElement[bool]) -> dict[int, dict[str, int]]:
    """Return how many jobs of some searches are in each state; none that is 0."""
    mine = (JobRow.search_id == SearchRow.id) & JobRow.state.in_(
        [literal_column("'running'"), literal_column("'dead'"), _FEW]
    )
    few = (
        select(SearchRow.id, JobRow.state, func.count())
        .select_from(SearchRow)
        .join(JobRow, mine)
        .where(wanted)
        .group_by(SearchRow.id, JobRow.state)
    )
    is_done = (TallyRow.search_id == SearchRow.id) & (TallyRow.noun == "job") & (TallyRow.name == "done")
    every = select(SearchRow.id, SearchRow.n_planned, _LEFT, TallyRow.number)
    every = every.select_from(SearchRow).outerjoin(TallyRow, is_done)
    found: dict[int, dict[str, int]] = defaultdict(dict)
    for search_id, state, number in session.execute(few):
        found[search_id][state] = number
    for search_id, n_planned, left, n_done in session.execute(every.where(wanted)):
        counts = found[search_id]
        counts["done"] = n_done or 0
        counts[left] = n_planned - sum(counts.values())
        found[search_id] = {state: number for state, number in counts.items() if number}
    return dict(found)


def summed(counts: Iterable[dict[str, int]]) -> dict[str, int]:
    """Return the sum of several counts by name."""
    total: Counter[str] = Counter()
    for one in counts:
        total.update(one)
    return dict(total)
