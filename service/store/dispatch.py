"""Taking back outcomes, each in one transaction behind the fence."""

import logging
from typing import Any, cast

from sqlalchemy import bindparam, update
from sqlalchemy.orm import Session
from sqlalchemy.orm.attributes import set_committed_value

from core.problem import content_hash
from service.db.dialect import insert_new, plain
from service.db.tables import AttemptRow, JobRow, ProvenanceRow, SearchRow
from service.logs import say
from service.scheduler import plan
from service.scheduler.leases import backoff_s
from service.store import archive
from service.store.errors import StoreError, UnknownRow
from service.store.events import note_job
from service.store.held import Held, find_held
from service.store.submission import go_on_after
from workers.dispatcher import StaleAttempt
from workers.executor import Ticket
from workers.job import CompleteAnswer, Ending, JobOutcome, SolveRecord

RESULTS = (Ending.FEASIBLE, Ending.INFEASIBLE, Ending.NUMERICAL, Ending.TIMEOUT)
#: Endings that say nothing about the job itself: it may run again.
FAILURES = (Ending.CRASH, Ending.LOST)

log = logging.getLogger(__name__)

_SEARCH = plain(SearchRow).c
_CHARGE = (
    update(plain(SearchRow))
    .where(_SEARCH.id == bindparam("row"))
    .values(
        n_solves=_SEARCH.n_solves + bindparam("number"),
        cpu_seconds=_SEARCH.cpu_seconds + bindparam("seconds"),
        served_s=_SEARCH.served_s + bindparam("seconds") / _SEARCH.weight,
    )
    .returning(_SEARCH.n_solves, _SEARCH.cpu_seconds, _SEARCH.served_s)
)


def complete(session: Session, ticket: Ticket, outcome: JobOutcome, now: float) -> CompleteAnswer:
    """Store an outcome, its solutions, their links and what follows from them, or refuse a late one.

    A report that was accepted before gets the stored answer, and changes nothing.
    """
    held = find_held(session, ticket)
    if held is None:
        return _stored_answer(session, ticket)
    job = held.job
    try:
        records = [record for record in outcome.solves if archive.add_solve(session, held, record, now)]
    except ValueError as error:
        raise StoreError(f"job {job.id}: {error}") from error
    _count(session, held.search, records)
    end_attempt(job, outcome.ending, now)
    _close_attempt(session, held.attempt, outcome, job.state, now)
    note_job(session, held.search, job, now)
    go_on_after(session, held, now)
    _log(session, held, outcome.ending)
    return _answer(ticket, job.state)


def _log(session: Session, held: Held, ending: Ending) -> None:
    job = held.job
    level = logging.DEBUG if ending in RESULTS else logging.WARNING
    message = f"attempt ended: {ending.value}, the job is {job.state}"
    ids = {"campaign": held.campaign.id, "job": job.id, "attempt": job.attempt, "worker": job.worker}
    say(session, log, level, message, **ids)


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
    if not records:
        return
    seconds = sum(record.cpu_seconds for record in records)
    # Added by the database: with PostgreSQL another coordinator may be adding at the same time.
    charged = {"row": search.id, "number": len(records), "seconds": seconds}
    for name, total in session.connection().execute(_CHARGE, charged).one()._mapping.items():
        set_committed_value(search, name, total)


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
    session: Session, attempt: AttemptRow, outcome: JobOutcome, next_state: str, now: float
) -> None:
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
