"""Handing out jobs and taking back outcomes, each in one transaction behind the fence."""

from typing import Any

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from core.problem import content_hash
from service.db.dialect import insert_new
from service.db.tables import (
    AttemptRow,
    CampaignRow,
    CaseRow,
    JobRow,
    ProblemRow,
    ProvenanceRow,
    SearchRow,
    SolutionRow,
)
from service.scheduler import plan
from service.store import archive
from service.store.events import note
from service.store.specs import search_spec
from service.store.submission import advance
from workers.dispatcher import StaleAttempt
from workers.executor import Ticket
from workers.job import Address, Claim, Ending, HopJob, JobOutcome, MapJob

RESULTS = (Ending.FEASIBLE, Ending.INFEASIBLE, Ending.NUMERICAL, Ending.TIMEOUT)


def claim(session: Session, worker: str, n_jobs: int, campaign: int | None, now: float) -> list[Claim]:
    """Return the next jobs of active campaigns, or of one of them, which are then the worker's."""
    query = (
        select(JobRow, SearchRow, CampaignRow)
        .join(SearchRow, SearchRow.id == JobRow.search_id)
        .join(CampaignRow, CampaignRow.id == SearchRow.campaign_id)
        .where(JobRow.state == "queued", CampaignRow.state == "active")
        .order_by(JobRow.priority, JobRow.id)
        .limit(n_jobs)
        .with_for_update(of=JobRow, skip_locked=True)
    )
    if campaign is not None:
        query = query.where(CampaignRow.id == campaign)
    return [_claimed(session, *rows, worker, now) for rows in session.execute(query).all()]


def _claimed(
    session: Session, job: JobRow, search: SearchRow, campaign: CampaignRow, worker: str, now: float
) -> Claim:
    job.state, job.attempt, job.worker, job.updated_at = "running", job.attempt + 1, worker, now
    session.add(AttemptRow(job_id=job.id, attempt=job.attempt, worker=worker, started_at=now))
    return Claim(job_id=job.id, attempt=job.attempt, job=_message(session, job, search, campaign))


def _message(session: Session, job: JobRow, search: SearchRow, campaign: CampaignRow) -> HopJob | MapJob:
    spec = search_spec(campaign, search)
    case = session.get_one(CaseRow, (search.id, job.case_index))
    chain = int(job.chain, 16)
    shared: dict[str, Any] = {
        "problem": _definition(session, case.problem_hash),
        "rng_seed": campaign.rng_seed,
        "address": Address(search=search.position, case=job.case_index, chain=chain, hop=job.hop),
        "settings": spec.settings,
    }
    if job.seed_id is None:
        return HopJob(**shared, n_hops=job.n_hops, laws=spec.laws)
    seed = session.get_one(SolutionRow, job.seed_id)
    return MapJob(
        **shared,
        seed_id=seed.id,
        seed_problem=_definition(session, seed.problem_hash),
        seed_x=tuple(seed.x.tolist()),
        mapping=job.mapping or "",
    )


def _definition(session: Session, problem_hash: str) -> dict[str, Any]:
    definition: dict[str, Any] = session.get_one(ProblemRow, problem_hash).definition
    return definition


def complete(session: Session, ticket: Ticket, outcome: JobOutcome, now: float) -> None:
    """Store an outcome, its solutions, their links and what follows from them, or refuse a late one."""
    job = _fenced(session, ticket, now)
    search = session.get_one(SearchRow, job.search_id)
    campaign = session.get_one(CampaignRow, search.campaign_id)
    provenance_hash = _provenance(session, outcome)
    _end_attempt(session, ticket, outcome, provenance_hash, now)
    for record in outcome.solves:
        archive.add_solve(session, campaign, search, job, record, now)
    job.state = _state_after(job, outcome.ending)
    job.ending = outcome.ending.value
    note(
        session,
        campaign.id,
        "job",
        now,
        job_id=job.id,
        search=search.name,
        search_id=search.id,
        state=job.state,
        ending=job.ending,
    )
    advance(session, campaign, now)


def _fenced(session: Session, ticket: Ticket, now: float) -> JobRow:
    """Return the job if this attempt still holds it."""
    held = (JobRow.id == ticket.job_id) & (JobRow.attempt == ticket.attempt) & (JobRow.state == "running")
    changed = session.execute(update(JobRow).where(held).values(updated_at=now).returning(JobRow.id)).first()
    if changed is None:
        raise StaleAttempt(
            f"job {ticket.job_id}: expected attempt {ticket.attempt} to hold it, got a stale report"
        )
    return session.get_one(JobRow, ticket.job_id, populate_existing=True)


def _state_after(job: JobRow, ending: Ending) -> str:
    if ending in RESULTS:
        return "done"
    if ending in (Ending.CRASH, Ending.LOST):
        job.n_failures += 1
    return plan.after_failure(ending.value, job.n_failures)


def _provenance(session: Session, outcome: JobOutcome) -> str | None:
    if outcome.provenance is None:
        return None
    content = outcome.provenance.model_dump(mode="json")
    key = content_hash(content)
    insert_new(session, ProvenanceRow, {"hash": key, "content": content})
    return key


def _end_attempt(
    session: Session, ticket: Ticket, outcome: JobOutcome, provenance_hash: str | None, now: float
) -> None:
    attempt = session.get_one(AttemptRow, tuple(ticket))
    attempt.ended_at, attempt.ending = now, outcome.ending.value
    attempt.error, attempt.provenance_hash = outcome.error, provenance_hash


def revive(session: Session, campaign_id: int, now: float) -> int:
    """Put back the jobs of a campaign that were given up, with a clean record; return how many."""
    campaign = session.get_one(CampaignRow, campaign_id)
    rows = session.scalars(select(SearchRow).where(SearchRow.campaign_id == campaign_id)).all()
    dead = (JobRow.search_id.in_([row.id for row in rows])) & (JobRow.state == "dead")
    jobs = session.scalars(select(JobRow).where(dead)).all()
    if not jobs:
        return 0
    open_again = {job.search_id for job in jobs}
    for job in jobs:
        job.state, job.n_failures, job.updated_at = "queued", 0, now
    # A source comes before what it feeds, which may get new seeds now.
    for row in sorted(rows, key=lambda row: row.id):
        if row.state == "done" and (row.id in open_again or row.source_id in open_again):
            row.state = "active" if row.id in open_again else "waiting"
            open_again.add(row.id)
    campaign.state, campaign.finished_at = "active", None
    advance(session, campaign, now)
    return len(jobs)


def recover(session: Session, now: float) -> int:
    """Put back what a process that is gone was working on; return how many jobs that were.

    This does not count as a failure of the job: the end of a whole process says nothing about it.
    """
    orphans = session.scalars(select(JobRow).where(JobRow.state == "running")).all()
    for job in orphans:
        job.state, job.updated_at = "queued", now
        attempt = session.get_one(AttemptRow, (job.id, job.attempt))
        attempt.ended_at, attempt.ending = now, Ending.LOST.value
    for campaign in session.scalars(select(CampaignRow).where(CampaignRow.state == "active")):
        advance(session, campaign, now)
    return len(orphans)
