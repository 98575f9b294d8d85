"""Leases: renewal by heartbeats, expiry, and pruning of old audit rows and events.

Results, jobs and attempts are never pruned.
"""

from collections.abc import Iterable, Sequence

from sqlalchemy import ColumnElement, delete, func, literal_column, select, tuple_, update
from sqlalchemy.orm import Session

from service.db.tables import AttemptRow, AuditRow, CampaignRow, EventRow, JobRow, SearchRow, WorkerRow
from service.store.completion import end_attempt
from service.store.events import add_job_event
from service.store.planning import advance
from service.store.statistics import Counts
from workers.messages import Ending, HeartbeatAnswer, HeldJob, Ticket

#: As text, since only then is the index of this state used.
_IS_RUNNING = JobRow.state == literal_column("'running'")
#: Jobs that one transaction takes back, so that others are not kept waiting.
REAP_AT_ONCE = 500


def heartbeat(
    session: Session, worker: str, held: Iterable[Ticket], now: float, lease_s: float, by: str | None = None
) -> HeartbeatAnswer:
    """Extend the leases that are still held; tell which jobs to cancel, and which are no longer held.

    What another token claimed than the one named, if any is, is not held.
    """
    tickets = sorted(set(held))
    row = session.get(WorkerRow, worker)
    if row is not None:
        row.seen_at = now
    statement = (
        update(JobRow)
        .where(_is_held(tickets, by))
        .values(lease_until=now + lease_s)
        .returning(JobRow.id, JobRow.attempt, JobRow.is_cancelling)
    )
    kept = {Ticket(job, attempt): flag for job, attempt, flag in session.execute(statement)}
    return HeartbeatAnswer(
        extended=_messages(ticket for ticket in tickets if ticket in kept),
        to_cancel=_messages(ticket for ticket in tickets if kept.get(ticket)),
        not_held=_messages(ticket for ticket in tickets if ticket not in kept),
    )


def look(session: Session, held: Iterable[Ticket], by: str | None = None) -> HeartbeatAnswer:
    """Tell which jobs to cancel, and which are no longer held; nothing is extended."""
    tickets = sorted(set(held))
    statement = select(JobRow.id, JobRow.attempt, JobRow.is_cancelling).where(_is_held(tickets, by))
    kept = {Ticket(job, attempt): flag for job, attempt, flag in session.execute(statement)}
    return HeartbeatAnswer(
        to_cancel=_messages(ticket for ticket in tickets if kept.get(ticket)),
        not_held=_messages(ticket for ticket in tickets if ticket not in kept),
    )


def _is_held(tickets: Sequence[Ticket], by: str | None) -> ColumnElement[bool]:
    is_held = (
        JobRow.id.in_([ticket.job_id for ticket in tickets])
        & tuple_(JobRow.id, JobRow.attempt).in_(tickets)
        & (JobRow.state == "running")
    )
    if by is None:
        return is_held
    own = (AttemptRow.job_id == JobRow.id) & (AttemptRow.attempt == JobRow.attempt)
    is_mine = AttemptRow.claimed_by.is_(None) | (AttemptRow.claimed_by == by)
    return is_held & select(AttemptRow.job_id).where(own, is_mine).exists()


def _messages(tickets: Iterable[Ticket]) -> tuple[HeldJob, ...]:
    return tuple(HeldJob(**ticket._asdict()) for ticket in tickets)


def reap(session: Session, now: float, lease_s: float) -> int:
    """Expire leases, each a failure of its job; return how many.

    A lease that ends later than any can was given before the clock was set back, and begins again.
    """
    session.execute(
        update(JobRow)
        .where(_IS_RUNNING, JobRow.lease_until > now + 2.0 * lease_s)
        .values(lease_until=now + lease_s)
    )
    expired = (
        select(JobRow)
        .where(_IS_RUNNING, JobRow.lease_until < now)
        .order_by(JobRow.id)
        .limit(REAP_AT_ONCE)
        .with_for_update(skip_locked=True)
    )
    jobs = session.scalars(expired).all()
    _log_losses(session, jobs, now)
    for job in jobs:
        end_attempt(job, Ending.LOST, now)
    _go_on(session, jobs, now)
    return len(jobs)


def renew(session: Session, now: float, lease_s: float) -> int:
    """Give every job that runs a whole lease, as if all workers had just been heard; return how many."""
    renewed = update(JobRow).where(_IS_RUNNING).values(lease_until=now + lease_s).returning(JobRow.id)
    return len(session.execute(renewed).all())


def recover(session: Session, workers: str, now: float) -> int:
    """Put back what workers were doing that are gone for sure; return how many jobs that were.

    This does not count as a failure of the job: the end of a whole process says nothing about it.
    """
    theirs = JobRow.worker.startswith(workers, autoescape=True)
    orphans = session.scalars(select(JobRow).where(JobRow.state == "running", theirs)).all()
    _log_losses(session, orphans, now)
    for job in orphans:
        job.state = "cancelled" if job.is_cancelling else "queued"
        job.lease_until, job.is_cancelling, job.updated_at = None, False, now
    _go_on(session, orphans, now)
    for campaign in session.scalars(select(CampaignRow).where(CampaignRow.state == "active")):
        advance(session, campaign, now)
    return len(orphans)


def _log_losses(session: Session, jobs: Sequence[JobRow], now: float) -> None:
    counts = Counts()
    for job in jobs:
        attempt = session.get_one(AttemptRow, (job.id, job.attempt))
        attempt.ended_at, attempt.ending = now, Ending.LOST.value
        attempt.error = f"lease: expected a heartbeat of {job.worker}, got none in time"
        counts.add(job.search_id, "attempt", Ending.LOST.value)
    counts.store(session)


def _go_on(session: Session, jobs: Sequence[JobRow], now: float) -> None:
    """Tell what became of jobs, and plan what follows: one that died may have been the last of a search."""
    campaigns = set()
    for job in jobs:
        search = session.get_one(SearchRow, job.search_id)
        add_job_event(session, search, job, now)
        campaigns.add(search.campaign_id)
    for campaign_id in sorted(campaigns):
        advance(session, session.get_one(CampaignRow, campaign_id), now)


DAY_S = 86400.0
#: So much of the audit stays: a busy client needs hours to write over what it did, and a year is for people.
AUDIT_ROWS, AUDIT_S = 1_000_000, 400 * DAY_S
#: Events kept for clients that reconnect: 80 MB, a quarter of an hour at 400 outcomes a second.
EVENT_ROWS = 500_000
#: Rows that go at once, since other writes wait meanwhile.
STEP = 2_000


def prune(session: Session, now: float) -> int:
    """Delete the oldest rows beyond what stays, a bounded number of them; return how many."""
    is_old = AuditRow.created_at < now - AUDIT_S
    return _prune(session, AuditRow, AUDIT_ROWS, is_old) + _prune(session, EventRow, EVENT_ROWS)


def _prune(
    session: Session, table: type[AuditRow | EventRow], n_rows: int, is_old: ColumnElement[bool] | None = None
) -> int:
    # Ids grow with time, so both ends are found without counting.
    first, last = session.execute(select(func.min(table.id), func.max(table.id))).one()
    if first is None:
        return 0
    is_over = table.id <= last - n_rows
    which = is_over if is_old is None else is_over | is_old
    oldest = (table.id < first + STEP) & which & (table.id < last)
    return len(session.execute(delete(table).where(oldest).returning(table.id)).all())
