"""Taking back outcomes, each in one transaction behind the fence."""

from typing import Any, cast

from sqlalchemy import update
from sqlalchemy.orm import Session

from core.problem import content_hash
from service.db.dialect import insert_new
from service.db.tables import AttemptRow, CampaignRow, JobRow, ProvenanceRow, SearchRow
from service.scheduler import plan
from service.scheduler.leases import backoff_s
from service.store import archive
from service.store.errors import StoreError, UnknownRow
from service.store.events import note_job
from service.store.submission import advance
from workers.dispatcher import StaleAttempt
from workers.executor import Ticket
from workers.job import CompleteAnswer, Ending, JobOutcome, SolveRecord

RESULTS = (Ending.FEASIBLE, Ending.INFEASIBLE, Ending.NUMERICAL, Ending.TIMEOUT)
#: Endings that say nothing about the job itself: it may run again.
FAILURES = (Ending.CRASH, Ending.LOST)


def complete(session: Session, ticket: Ticket, outcome: JobOutcome, now: float) -> CompleteAnswer:
    """Store an outcome, its solutions, their links and what follows from them, or refuse a late one.

    A report that was accepted before gets the stored answer, and changes nothing.
    """
    job = _fenced(session, ticket, now)
    if job is None:
        return _stored_answer(session, ticket)
    search = session.get_one(SearchRow, job.search_id)
    campaign = session.get_one(CampaignRow, search.campaign_id)
    try:
        records = [r for r in outcome.solves if archive.add_solve(session, campaign, search, job, r, now)]
    except ValueError as error:
        raise StoreError(f"job {job.id}: {error}") from error
    _count(session, search, records)
    end_attempt(job, outcome.ending, now)
    _close_attempt(session, ticket, outcome, job.state, now)
    note_job(session, search, job, now)
    advance(session, campaign, now)
    return _answer(ticket, job.state)


def _fenced(session: Session, ticket: Ticket, now: float) -> JobRow | None:
    """Return the job if this attempt still holds it."""
    held = (JobRow.id == ticket.job_id) & (JobRow.attempt == ticket.attempt) & (JobRow.state == "running")
    changed = session.execute(update(JobRow).where(held).values(updated_at=now).returning(JobRow.id)).first()
    return changed and session.get_one(JobRow, ticket.job_id, populate_existing=True)


def _stored_answer(session: Session, ticket: Ticket) -> CompleteAnswer:
    if session.get(JobRow, ticket.job_id) is None:
        raise UnknownRow("job", ticket.job_id)
    attempt = session.get(AttemptRow, tuple(ticket))
    if attempt is None or attempt.next_state is None:
        raise StaleAttempt(
            f"job {ticket.job_id}: expected attempt {ticket.attempt} to hold it, got a stale report"
        )
    return _answer(ticket, attempt.next_state)


def _answer(ticket: Ticket, state: str) -> CompleteAnswer:
    return CompleteAnswer(job_id=ticket.job_id, attempt=ticket.attempt, state=cast(Any, state))


def _count(session: Session, search: SearchRow, records: list[SolveRecord]) -> None:
    """Charge a search with the solves that are new in the archive."""
    seconds = sum(record.cpu_seconds for record in records)
    totals = {
        "n_solves": SearchRow.n_solves + len(records),
        "cpu_seconds": SearchRow.cpu_seconds + seconds,
        "served_s": SearchRow.served_s + seconds / SearchRow.weight,
    }
    session.execute(
        update(SearchRow).where(SearchRow.id == search.id).values(totals),
        execution_options={"synchronize_session": False},
    )
    session.refresh(search)


def end_attempt(job: JobRow, ending: Ending, now: float) -> None:
    """Give a running job the state that follows from how its attempt ended."""
    if ending in FAILURES and not job.is_cancelling:
        job.n_failures += 1
        job.not_before = now + backoff_s(job.n_failures)
    job.state = _state_after(job, ending)
    job.ending, job.lease_until, job.is_cancelling, job.updated_at = ending.value, None, False, now


def _state_after(job: JobRow, ending: Ending) -> str:
    if ending in RESULTS:
        # Kept even if it was to be cancelled: it has been paid for.
        return "done"
    if job.is_cancelling and ending is not Ending.ERROR:
        return "cancelled"
    return plan.after_failure(ending.value, job.n_failures)


def _close_attempt(
    session: Session, ticket: Ticket, outcome: JobOutcome, next_state: str, now: float
) -> None:
    attempt = session.get_one(AttemptRow, tuple(ticket))
    attempt.ended_at, attempt.ending, attempt.next_state = now, outcome.ending.value, next_state
    # PostgreSQL has no place for a NUL, which the last words of a process may hold.
    attempt.error = outcome.error and outcome.error.replace("\0", "\ufffd")
    attempt.provenance_hash = _provenance(session, outcome)


def _provenance(session: Session, outcome: JobOutcome) -> str | None:
    if outcome.provenance is None:
        return None
    content = outcome.provenance.model_dump(mode="json")
    key = content_hash(content)
    insert_new(session, ProvenanceRow, {"hash": key, "content": content})
    return key
