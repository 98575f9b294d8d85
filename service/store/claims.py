"""Handing out jobs: whose turn it is, and the lease that begins."""

from collections.abc import Iterator
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.db.tables import AttemptRow, CampaignRow, CaseRow, JobRow, ProblemRow, SearchRow, SolutionRow
from service.scheduler.sharing import Share, in_turn, mean_cost_s
from service.store.specs import search_spec
from workers.job import Address, Claim, HopJob, MapJob


def claim(
    session: Session, worker: str, n_jobs: int, campaign: int | None, now: float, lease_s: float
) -> list[Claim]:
    """Return the next jobs of active campaigns, or of one of them, which are then the worker's."""
    queues: dict[int, Iterator[JobRow]] = {}

    def take(search_id: int) -> tuple[JobRow, int] | None:
        queue = queues.setdefault(search_id, _queue(session, search_id, n_jobs, now))
        job = next(queue, None)
        return None if job is None else (job, job.n_hops)

    jobs = in_turn(_shares(session, campaign, now), take, n_jobs) if n_jobs else []
    return [_claimed(session, job, worker, now, lease_s) for job in jobs]


def _is_ready(now: float) -> Any:
    return (JobRow.state == "queued") & (JobRow.not_before <= now)


def _queue(session: Session, search_id: int, n_jobs: int, now: float) -> Iterator[JobRow]:
    query = (
        select(JobRow)
        .where(JobRow.search_id == search_id, _is_ready(now))
        .order_by(JobRow.priority, JobRow.id)
        .limit(n_jobs)
        .with_for_update(skip_locked=True)
    )
    return iter(session.scalars(query).all())


def _shares(session: Session, campaign: int | None, now: float) -> list[Share]:
    """Return the searches that have a job to hand out."""
    mine = JobRow.search_id == SearchRow.id
    running = select(func.coalesce(func.sum(JobRow.n_hops), 0)).where(mine, JobRow.state == "running")
    query = (
        select(SearchRow, CampaignRow.priority, running.scalar_subquery())
        .join(CampaignRow, CampaignRow.id == SearchRow.campaign_id)
        .where(SearchRow.state == "active", CampaignRow.state == "active")
        .where(select(JobRow.id).where(mine, _is_ready(now)).exists())
    )
    if campaign is not None:
        query = query.where(CampaignRow.id == campaign)
    return [
        Share(
            search.id,
            (campaign_priority, search.priority),
            search.weight,
            search.served_s,
            int(n_running),
            mean_cost_s(search.cpu_seconds, search.n_solves),
        )
        for search, campaign_priority, n_running in session.execute(query)
    ]


def _claimed(session: Session, job: JobRow, worker: str, now: float, lease_s: float) -> Claim:
    job.state, job.attempt, job.worker = "running", job.attempt + 1, worker
    job.lease_until, job.updated_at = now + lease_s, now
    session.add(AttemptRow(job_id=job.id, attempt=job.attempt, worker=worker, started_at=now))
    search = session.get_one(SearchRow, job.search_id)
    campaign = session.get_one(CampaignRow, search.campaign_id)
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
