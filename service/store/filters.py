"""Which solutions are asked for: filters, pages of a sorted list, and campaigns by id or name.

A page is found by the values of the last item of the one before (keyset pagination), so what arrives
meanwhile neither repeats nor hides anything.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import ValidationError
from sqlalchemy import ColumnElement, ScalarSelect, and_, exists, func, or_, select
from sqlalchemy.orm import Session, aliased

from core.problem import validation_message
from service.db.tables import CampaignRow, CaseRow, ProblemRow, SearchRow, SolutionRow, SolveRow
from service.schemas.solution import RANGES, CampaignChoice, ChoicesView, Filter
from service.store.errors import StoreError, UnknownRowError

#: Durations that differ by less are the same [d].
SAME_DURATION = 1e-6

#: Solves beside the one that a record shows.
_Again = aliased(SolveRow)


def filter_of(**fields: Any) -> Filter:
    """Return the filter that a user describes, or say what is wrong with it."""
    try:
        return Filter(**fields)
    except ValidationError as error:
        raise StoreError(validation_message("filter", error, Filter)) from error


class Wanted:
    """A filter whose names have been looked up, since there are few searches and problems."""

    def __init__(self, session: Session, wanted: Filter) -> None:
        self._wanted = wanted
        self._searches = _search_ids(session, wanted)
        self._problems = _problem_hashes(session, wanted)

    def conditions(self) -> list[ColumnElement[bool]]:
        """Return what a solution has to fulfil."""
        found = [*self._tolerances(), *self._ranges()]
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
        first: ScalarSelect[int] = self._solves(func.min(_Again.id)).correlate(SolutionRow).scalar_subquery()
        return first

    def first_cpu_seconds(self) -> Any:
        """Return the processor time of the same solve, which the index holds."""
        first = self._solves(_Again.cpu_seconds).order_by(_Again.id).limit(1)
        return first.correlate(SolutionRow).scalar_subquery()

    def _solves(self, column: Any) -> Any:
        query = select(column).where(_Again.solution_id == SolutionRow.id)
        if self._searches is None:
            return query
        # A sum, so that it cannot be looked up: the solves of a solution are few, those of a search are many,
        # and SQLite, which does not know that, would go through all of the latter for each solution.
        return query.where((_Again.search_id + 0).in_(self._searches))

    def _tolerances(self) -> list[ColumnElement[bool]]:
        return [getattr(SolutionRow, name) == is_held for name, is_held in sorted(self._wanted.levels())]

    def _ranges(self) -> list[ColumnElement[bool]]:
        found: list[ColumnElement[bool]] = []
        for name in RANGES:
            least, most = (getattr(self._wanted, f"{end}_{name}") for end in ("min", "max"))
            if name == "k" or (least, most) == (None, None):
                continue
            column = self.first_cpu_seconds() if name == "cpu_seconds" else getattr(SolutionRow, name)
            if least is not None:
                found.append(column >= least)
            if most is not None:
                found.append(column <= most)
        return found


def _search_ids(session: Session, wanted: Filter) -> Sequence[int] | None:
    query = select(SearchRow.id)
    if wanted.campaign is not None:
        query = query.where(SearchRow.campaign_id == wanted.campaign)
    if wanted.search is not None:
        query = query.where(SearchRow.name == wanted.search)
    if wanted.strategy is not None:
        query = query.where(SearchRow.strategy == wanted.strategy)
    if (wanted.campaign, wanted.search, wanted.strategy) == (None, None, None):
        return None
    found = session.scalars(query).all()
    # A filter that all pass, as that of the only campaign, costs as much as any.
    n_all = session.scalar(select(func.count(SearchRow.id)))
    return None if len(found) == n_all else found


def _problem_hashes(session: Session, wanted: Filter) -> list[str] | None:
    has_outage = (wanted.segment, wanted.duration_days) != (None, None)
    if not has_outage and (wanted.k, wanted.min_k, wanted.max_k) == (None, None, None):
        return None
    query = select(ProblemRow.hash, *((ProblemRow.definition,) if has_outage else ()))
    if wanted.k is not None:
        query = query.where(ProblemRow.k == wanted.k)
    if wanted.min_k is not None:
        query = query.where(ProblemRow.k >= wanted.min_k)
    if wanted.max_k is not None:
        query = query.where(ProblemRow.k <= wanted.max_k)
    rows = session.execute(query)
    return [row[0] for row in rows if not has_outage or _survives(row[1]["outages"], wanted)]


def _survives(outages: list[dict[str, Any]], wanted: Filter) -> bool:
    days = wanted.duration_days
    return any(
        wanted.segment in (None, outage["segment"])
        and (days is None or abs(outage["duration_days"] - days) <= SAME_DURATION)
        for outage in outages
    )


def find_campaign(session: Session, name_or_id: str) -> int:
    """Return the newest campaign of a name, or else that of an id."""
    found = look_up_campaign(session, name_or_id)
    if found is None:
        raise UnknownRowError("campaign", name_or_id, "none with this name or id")
    return found


def look_up_campaign(session: Session, name_or_id: str) -> int | None:
    """Return the campaign of an id, or else the newest of a name, or None."""
    found = None
    # A campaign may be named "7", and must not hide the seventh.
    if name_or_id.isdecimal() and len(name_or_id) < 19:
        found = session.scalar(select(CampaignRow.id).where(CampaignRow.id == int(name_or_id)))
    if found is None:
        found = session.scalar(select(func.max(CampaignRow.id)).where(CampaignRow.name == name_or_id))
    return found


def campaign_state(session: Session, campaign_id: int) -> str:
    """Return the state of a campaign."""
    state = session.scalar(select(CampaignRow.state).where(CampaignRow.id == campaign_id))
    if state is None:
        raise UnknownRowError("campaign", campaign_id)
    return state


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


#: Campaigns that are listed, the newest.
CAMPAIGNS = 200


def list_choices(session: Session, campaign: int | None) -> ChoicesView:
    """Return the names of campaigns, and what there is in one of them or in all."""
    newest = select(CampaignRow.id, CampaignRow.name).order_by(CampaignRow.id.desc()).limit(CAMPAIGNS)
    searches = select(SearchRow.name, SearchRow.strategy).distinct()
    problems = select(ProblemRow.k, ProblemRow.definition)
    if campaign is not None:
        searches = searches.where(SearchRow.campaign_id == campaign)
        cases = (
            select(CaseRow.problem_hash)
            .join(SearchRow, SearchRow.id == CaseRow.search_id)
            .where(SearchRow.campaign_id == campaign)
        )
        problems = problems.where(ProblemRow.hash.in_(cases))
    named, found = session.execute(searches).all(), session.execute(problems).all()
    outages = [outage for _, definition in found for outage in definition["outages"]]
    return ChoicesView(
        campaigns=[CampaignChoice(id=key, name=name) for key, name in session.execute(newest)],
        searches=sorted({name for name, _ in named}),
        strategies=sorted({strategy for _, strategy in named}),
        k=sorted({k for k, _ in found}),
        segments=sorted({outage["segment"] for outage in outages}),
        durations_days=sorted({outage["duration_days"] for outage in outages}),
    )
