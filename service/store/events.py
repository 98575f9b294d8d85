"""The event log that live pages follow."""

from typing import Any

from sqlalchemy import func, insert, select
from sqlalchemy.orm import Session

from service.db.dialect import flush_new, plain
from service.db.tables import EventRow, JobRow, SearchRow
from service.schemas.job import EventView

_NOTE = insert(plain(EventRow))


def add_event(session: Session, campaign_id: int, kind: str, now: float, **data: Any) -> None:
    """Write an event in the transaction of what happened."""
    add_events(session, [event_of(campaign_id, kind, now, **data)])


def event_of(campaign_id: int, kind: str, now: float, **data: Any) -> dict[str, Any]:
    """Return an event that is to be stored with others."""
    return {"campaign_id": campaign_id, "kind": kind, "data": data, "created_at": now}


def add_events(session: Session, events: list[dict[str, Any]]) -> None:
    """Write events in their order."""
    flush_new(session)
    if events:
        session.connection().execute(_NOTE, events)


def add_job_event(session: Session, search: SearchRow, job: JobRow, now: float) -> None:
    """Write the event of a job that got another state."""
    add_events(session, [job_event(search, job, now)])


def job_event(search: SearchRow, job: JobRow, now: float) -> dict[str, Any]:
    """Return the event of a job that got another state, to be stored with others."""
    data = {"job_id": job.id, "search": search.name, "search_id": search.id}
    return event_of(search.campaign_id, "job", now, **data, state=job.state, ending=job.ending)


def add_search_event(session: Session, search: SearchRow, now: float) -> None:
    """Write the event of a search that got another state."""
    add_event(
        session,
        search.campaign_id,
        "search",
        now,
        search=search.name,
        search_id=search.id,
        state=search.state,
    )


def events_after(session: Session, after: int, campaign_id: int | None, limit: int) -> list[EventView]:
    """Return the events that follow the id `after`, the oldest first."""
    query = select(EventRow).where(EventRow.id > after).order_by(EventRow.id).limit(limit)
    if campaign_id is not None:
        query = query.where(EventRow.campaign_id == campaign_id)
    return [EventView.model_validate(row) for row in session.scalars(query)]


def last_event_id(session: Session, campaign_id: int | None) -> int:
    """Return the id of the latest event of a campaign, or of all, or 0."""
    query = select(func.max(EventRow.id))
    if campaign_id is not None:
        query = query.where(EventRow.campaign_id == campaign_id)
    return session.scalar(query) or 0
