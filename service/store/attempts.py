"""Attempts: those of a window of time, and those at a job."""

from collections.abc import Sequence
from typing import Any

from sqlalchemy import ColumnElement, func, select
from sqlalchemy.orm import Session

from service.db.dialect import is_drawn
from service.db.tables import AttemptRow, JobRow, SearchRow
from service.schemas.job import AttemptPage, AttemptsOfJob
from service.store.errors import UnknownRow

SHOWN = (
    AttemptRow.job_id,
    AttemptRow.attempt,
    AttemptRow.worker,
    SearchRow.campaign_id,
    SearchRow.name.label("search"),
    SearchRow.strategy,
    JobRow.kind,
    AttemptRow.started_at,
    AttemptRow.ended_at,
    AttemptRow.ending,
)


def attempts_between(session: Session, since: float, until: float, limit: int) -> AttemptPage:
    """Return the attempts that were going on in a window; if there are too many, some that ended in it."""
    begun = AttemptRow.started_at <= until
    ended, is_open = begun & (AttemptRow.ended_at >= since), begun & AttemptRow.ended_at.is_(None)
    n_ended, n_open = _number(session, ended), _number(session, is_open)
    n_wanted = max(0, limit - n_open)
    if n_ended > n_wanted:
        ended &= is_drawn(AttemptRow.job_id, n_wanted, n_ended)
    # Each by itself, so that both are looked up in the index.
    found = [*_rows(session, is_open, limit), *_rows(session, ended, n_wanted)]
    found.sort(key=lambda row: (row["started_at"], row["job_id"]))
    fields = {"since": since, "until": until, "items": found, "n_all": n_ended + n_open}
    return AttemptPage.model_validate(fields)


def _number(session: Session, condition: ColumnElement[bool]) -> int:
    return session.scalar(select(func.count()).select_from(AttemptRow).where(condition)) or 0


def _rows(session: Session, condition: ColumnElement[bool], limit: int) -> Sequence[Any]:
    return session.execute(_attempts(condition).limit(limit)).mappings().all()


def _attempts(condition: ColumnElement[bool], *more: Any) -> Any:
    return (
        select(*SHOWN, *more)
        .join(JobRow, JobRow.id == AttemptRow.job_id)
        .join(SearchRow, SearchRow.id == JobRow.search_id)
        .where(condition)
    )


def attempts_of_job(session: Session, job_id: int, limit: int = 50) -> AttemptsOfJob:
    """Return the latest attempts at a job, with what went wrong in full."""
    if session.get(JobRow, job_id) is None:
        raise UnknownRow("job", job_id)
    query = _attempts(AttemptRow.job_id == job_id, AttemptRow.error).order_by(AttemptRow.attempt.desc())
    found = session.execute(query.limit(limit)).mappings()
    return AttemptsOfJob.model_validate({"items": list(found)})
