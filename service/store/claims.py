"""Claims of jobs, their leases, and the lock of an attempt that holds a job.

A locked attempt is read at once with all that recording its outcome needs.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from sqlalchemy import bindparam, func, insert, literal_column, select, tuple_
from sqlalchemy.orm import Session

from service.db.dialect import plain
from service.db.tables import AttemptRow, CampaignRow, CaseRow, JobRow, SearchRow, SolutionRow, SolveRow
from service.scheduler import LONGEST_BACKOFF_S, Share, in_turn, mean_cost_s
from service.store.cache import definition_of, layout_of_problem, search_spec
from service.store.errors import OtherClaimantError
from workers.messages import Address, ChainPlace, Claim, HopJob, MapJob, Ticket

# Statements are made once: to build one takes longer than to run it.  States stand in them as text, since
# only then are the indexes of one state used.
_MINE = JobRow.search_id == SearchRow.id
# A wait longer than any that a failure leads to was fixed before the clock was set back.
_IS_DUE = (JobRow.not_before <= bindparam("now")) | (JobRow.not_before - LONGEST_BACKOFF_S > bindparam("now"))
_IS_READY = (JobRow.state == literal_column("'queued'")) & _IS_DUE
_RUNNING = select(func.coalesce(func.sum(JobRow.n_hops), 0)).where(_MINE, JobRow.state == "running")
_SHARES = (
    select(SearchRow, CampaignRow, _RUNNING.scalar_subquery())
    .join(CampaignRow, CampaignRow.id == SearchRow.campaign_id)
    .where(SearchRow.state == "active", CampaignRow.state == "active")
    .where(select(JobRow.id).where(_MINE, _IS_READY).exists())
)
_SHARES_OF_ONE = _SHARES.where(CampaignRow.id == bindparam("campaign"))
_QUEUE = (
    select(JobRow, CaseRow.problem_hash)
    .join(CaseRow, (CaseRow.search_id == JobRow.search_id) & (CaseRow.position == JobRow.case_index))
    .where(JobRow.search_id == bindparam("search_id"), _IS_READY)
    .order_by(JobRow.priority, JobRow.id)
    .limit(bindparam("most"))
    .with_for_update(of=JobRow, skip_locked=True)
)
_ATTEMPT = insert(plain(AttemptRow))
_SOLUTION = plain(SolutionRow).c
_SEEDS = select(_SOLUTION.id, _SOLUTION.problem_hash, _SOLUTION.x).where(
    _SOLUTION.id.in_(bindparam("ids", expanding=True))
)


class Turn(NamedTuple):
    """A job to be handed out, and what it is about."""

    job: JobRow
    problem_hash: str
    search: SearchRow
    campaign: CampaignRow


def claim(
    session: Session,
    worker: str,
    n_jobs: int,
    campaign: int | None,
    now: float,
    lease_s: float,
    by: str | None = None,
) -> list[Claim]:
    """Return the next jobs of active campaigns, or of one of them, which are then the worker's.

    `by` names the token that asks: it alone extends and ends what it has claimed.
    """
    if not n_jobs:
        return []
    statement, wanted = (_SHARES, {}) if campaign is None else (_SHARES_OF_ONE, {"campaign": campaign})
    found = {row[0].id: row for row in session.execute(statement, {"now": now, **wanted})}
    queues: dict[int, Iterator[Any]] = {}

    def take(search_id: int) -> tuple[Turn, int] | None:
        if search_id not in queues:
            asked = {"search_id": search_id, "now": now, "most": n_jobs}
            queues[search_id] = iter(session.execute(_QUEUE, asked).all())
        row = next(queues[search_id], None)
        return None if row is None else (Turn(*row, *found[search_id][:2]), row[0].n_hops)

    shares = [_share(search, owner, n_running) for search, owner, n_running in found.values()]
    turns = in_turn(shares, take, n_jobs)
    seeds = seeds_of(session, turns)
    claims = [_claim(session, turn, seeds, worker, now, lease_s) for turn in turns]
    if claims:
        attempts = [(claim.job_id, claim.attempt) for claim in claims]
        common = {"worker": worker, "claimed_by": by, "started_at": now}
        rows = [{"job_id": i, "attempt": n} | common for i, n in attempts]
        session.connection().execute(_ATTEMPT, rows)
    return claims


def _share(search: SearchRow, campaign: CampaignRow, n_running: int) -> Share:
    return Share(
        search.id,
        (campaign.priority, search.priority),
        search.weight,
        search.served_s,
        int(n_running),
        mean_cost_s(search.cpu_seconds, search.n_solves),
    )


def seeds_of(session: Session, turns: Sequence[Turn]) -> dict[str, Any]:
    """Return problems and vectors of the seeds of jobs."""
    wanted = [turn.job.seed_id for turn in turns if turn.job.seed_id is not None]
    if not wanted:
        return {}
    return {row.id: row for row in session.connection().execute(_SEEDS, {"ids": wanted})}


def _claim(
    session: Session, turn: Turn, seeds: dict[str, Any], worker: str, now: float, lease_s: float
) -> Claim:
    job = turn.job
    job.state, job.attempt, job.worker = "running", job.attempt + 1, worker
    job.lease_until, job.updated_at = now + lease_s, now
    message = message_of(session, turn, seeds)
    if job.attempt > 1 and (place := _place_of(session, job)):
        message = message.model_copy(update={"place": place})
    return Claim(job_id=job.id, attempt=job.attempt, job=message)


def _place_of(session: Session, job: JobRow) -> ChainPlace | None:
    """Return where a chain goes on that has handed in hops, or None for its start."""
    if job.place is None:
        return None
    place = ChainPlace.model_validate(job.place)
    before = (SolveRow.job_id == job.id) & (SolveRow.hop < place.next_hop)
    n_stored = session.scalar(select(func.count()).select_from(SolveRow).where(before))
    # What was set aside since has to be found again.
    return place if n_stored == place.next_hop - job.hop else None


def message_of(session: Session, turn: Turn, seeds: dict[str, Any]) -> HopJob | MapJob:
    """Return all that the run of a job needs; a result follows from it alone."""
    job, problem_hash, search, campaign = turn
    spec = search_spec(campaign, search)
    chain = int(job.chain, 16)
    shared: dict[str, Any] = {
        "problem": definition_of(session, problem_hash),
        "rng_seed": campaign.rng_seed,
        "address": Address(search=search.position, case=job.case_index, chain=chain, hop=job.hop),
        "settings": spec.settings,
    }
    if job.seed_id is None:
        return HopJob(**shared, n_hops=job.n_hops, laws=spec.laws)
    seed = seeds[job.seed_id]
    definition, x = definition_of(session, seed.problem_hash), seed.x
    if spec.seed_k == 0 and definition["outages"]:
        # A solution that was named for its reference.
        x = x[: layout_of_problem(session, seed.problem_hash).reference.stop]
        definition = definition | {"outages": []}
    return MapJob(
        **shared,
        seed_id=seed.id,
        seed_problem=definition,
        seed_x=x,
        mapping=job.mapping or "",
    )


@dataclass(slots=True)
class LockedAttempt:
    """A running job and what it belongs to."""

    job: JobRow
    attempt: AttemptRow
    search: SearchRow
    campaign: CampaignRow
    problem_hash: str


@dataclass(slots=True)
class Worked:
    """What one transaction has done to a search."""

    search: SearchRow
    campaign: CampaignRow
    #: Solves that are new in the archive, and their processor time [s].
    n_solves: int = 0
    cpu_seconds: float = 0.0
    events: list[dict[str, Any]] = field(default_factory=list)
    #: Hashes of the provenances that are stored, by their text.
    provenances: dict[str, str] = field(default_factory=dict)
    #: The searches that take its seeds, with their campaigns, once somebody has asked.
    takers: Sequence[tuple[SearchRow, CampaignRow]] | None = None
    #: Those of them that its solutions have given jobs.
    fed: dict[int, tuple[SearchRow, CampaignRow]] = field(default_factory=dict)


_HELD = (
    select(JobRow, AttemptRow, SearchRow, CampaignRow, CaseRow.problem_hash)
    .join(AttemptRow, (AttemptRow.job_id == JobRow.id) & (AttemptRow.attempt == JobRow.attempt))
    .join(SearchRow, SearchRow.id == JobRow.search_id)
    .join(CampaignRow, CampaignRow.id == SearchRow.campaign_id)
    .join(CaseRow, (CaseRow.search_id == JobRow.search_id) & (CaseRow.position == JobRow.case_index))
    # By id, so that the index is used; then by what fences.
    .where(JobRow.id.in_(bindparam("job_ids", expanding=True)))
    .where(tuple_(JobRow.id, JobRow.attempt).in_(bindparam("tickets", expanding=True)))
    .where(JobRow.state == bindparam("state"))
    # The fence: nobody else writes before this transaction ends.
    .with_for_update(of=JobRow)
)


def lock_attempt(
    session: Session, tickets: Sequence[Ticket], by: str | None = None, state: str = "running"
) -> dict[Ticket, LockedAttempt]:
    """Return what attempts hold; those that no longer hold their jobs are not among them.

    One that another token claimed than the one named, if any is, is refused.  With the state `queued`, those
    whose jobs went back to the queue and have been handed to nobody since.
    """
    wanted = {
        "state": state,
        "job_ids": [ticket.job_id for ticket in tickets],
        "tickets": [tuple(ticket) for ticket in tickets],
    }
    found = [LockedAttempt(*row) for row in session.execute(_HELD, wanted)]
    for held in found:
        require_claimant(held.attempt, by)
    return {Ticket(held.job.id, held.job.attempt): held for held in found}


def require_claimant(attempt: AttemptRow, by: str | None) -> None:
    """Refuse a token that did not claim an attempt."""
    if by is not None and attempt.claimed_by not in (None, by):
        raise OtherClaimantError(
            f"job {attempt.job_id}: expected the token that claimed attempt {attempt.attempt}, got {by}; "
            f"report with the token that claimed, or with one of the same name"
        )
