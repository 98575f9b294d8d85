"""Which solutions are asked for, as conditions of a query."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from sqlalchemy import ColumnElement, ScalarSelect, exists, func, select
from sqlalchemy.orm import Session, aliased

from service.db.tables import ProblemRow, SearchRow, SolutionRow, SolveRow

Tolerance = Literal["strict", "paper", "all"]

#: Durations that differ by less are the same [d].
SAME_DURATION = 1e-6
#: Bounds of a filter, and the columns that they are about.
LEAST = {"min_delta_v_km_s": "delta_v_km_s", "min_time_of_flight_days": "time_of_flight_days"}
MOST = {"max_delta_v_km_s": "delta_v_km_s", "max_time_of_flight_days": "time_of_flight_days"}

#: Solves beside the one that a record shows.
_Again = aliased(SolveRow)


@dataclass(frozen=True, slots=True)
class Filter:
    """What is None does not restrict; an outage is one with both the segment and the duration."""

    campaign: int | None = None
    search: str | None = None
    #: Strict ones alone, or those alone that are not.
    strict: bool | None = None
    strategy: str | None = None
    k: int | None = None
    segment: int | None = None
    duration_days: float | None = None
    #: What holds at the strict tolerance holds at the paper's as well.
    tolerance: Tolerance = "all"
    min_delta_v_km_s: float | None = None
    max_delta_v_km_s: float | None = None
    min_time_of_flight_days: float | None = None
    max_time_of_flight_days: float | None = None


class Wanted:
    """A filter whose names have been looked up, since there are few searches and problems."""

    def __init__(self, session: Session, wanted: Filter) -> None:
        self._wanted = wanted
        self._searches = _search_ids(session, wanted)
        self._problems = _problem_hashes(session, wanted)

    def conditions(self) -> list[ColumnElement[bool]]:
        """Return what a solution has to fulfil."""
        found = self._conditions_on_columns()
        if self._problems is not None:
            found.append(SolutionRow.problem_hash.in_(self._problems))
        if self._searches is not None:
            found.append(exists(self._solves(_Again.id).correlate(SolutionRow)))
        return found

    def searches(self, session: Session) -> Sequence[int]:
        """Return the searches inside the filter."""
        return session.scalars(select(SearchRow.id)).all() if self._searches is None else self._searches

    def first_solve(self) -> ScalarSelect[int]:
        """Return the first solve inside the filter that found the solution of the query around it."""
        return self._solves(func.min(_Again.id)).correlate(SolutionRow).scalar_subquery()

    def _solves(self, column: Any) -> Any:
        query = select(column).where(_Again.solution_id == SolutionRow.id)
        return query if self._searches is None else query.where(_Again.search_id.in_(self._searches))

    def _conditions_on_columns(self) -> list[ColumnElement[bool]]:
        wanted = self._wanted
        found: list[ColumnElement[bool]] = []
        if wanted.strict is not None:
            found.append(SolutionRow.strict == wanted.strict)
        if wanted.tolerance == "strict":
            found.append(SolutionRow.strict == True)  # noqa: E712 - a condition, not a comparison
        elif wanted.tolerance == "paper":
            found.append(SolutionRow.paper == True)  # noqa: E712
        for name, column in LEAST.items():
            if (value := getattr(wanted, name)) is not None:
                found.append(getattr(SolutionRow, column) >= value)
        for name, column in MOST.items():
            if (value := getattr(wanted, name)) is not None:
                found.append(getattr(SolutionRow, column) <= value)
        return found


def _search_ids(session: Session, wanted: Filter) -> Sequence[int] | None:
    query = select(SearchRow.id)
    if wanted.campaign is not None:
        query = query.where(SearchRow.campaign_id == wanted.campaign)
    if wanted.search is not None:
        query = query.where(SearchRow.name == wanted.search)
    if wanted.strategy is not None:
        query = query.where(SearchRow.strategy == wanted.strategy)
    if wanted.campaign is wanted.search is wanted.strategy is None:
        return None
    return session.scalars(query).all()


def _problem_hashes(session: Session, wanted: Filter) -> list[str] | None:
    if wanted.k is wanted.segment is wanted.duration_days is None:
        return None
    query = select(ProblemRow.hash, ProblemRow.definition)
    if wanted.k is not None:
        query = query.where(ProblemRow.k == wanted.k)
    return [key for key, definition in session.execute(query) if _has_outage(definition["outages"], wanted)]


def _has_outage(outages: list[dict[str, Any]], wanted: Filter) -> bool:
    if wanted.segment is wanted.duration_days is None:
        return True
    return any(
        wanted.segment in (None, outage["segment"])
        and (
            wanted.duration_days is None
            or abs(outage["duration_days"] - wanted.duration_days) <= SAME_DURATION
        )
        for outage in outages
    )
