"""Problems, jobs, attempts and the queue, as lists."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

from sqlalchemy import ColumnElement, Select, func, literal, literal_column, select, true, union_all
from sqlalchemy.orm import Session, aliased

from core.world import World, world_from
from service.db.dialect import is_drawn
from service.db.engine import Database
from service.db.tables import JOB_STATES, AttemptRow, CampaignRow, JobRow, ProblemRow, SearchRow
from service.scheduler import LeaseSettings
from service.schemas.job import AttemptPage, AttemptsOfJob, JobPage, JobView, QueueView
from service.schemas.problem import (
    OutageView,
    ProblemItem,
    ProblemPage,
    ProblemView,
    ToleranceView,
    WorldView,
)
from service.schemas.search import HopsView, SearchDetail
from service.store import searches
from service.store.errors import StoreError, UnknownRowError
from service.store.statistics import job_states, sum_counts

#: What a job's view takes from other rows.
ELSEWHERE = ("campaign_id", "search", "error")

_Next, _Each = aliased(JobRow), aliased(JobRow)


def list_problems(session: Session, limit: int = 200) -> ProblemPage:
    """Return the problems, those with few outages first."""
    rows = session.scalars(select(ProblemRow).order_by(ProblemRow.k, ProblemRow.hash).limit(limit))
    return ProblemPage(items=[_item(row) for row in rows])


def get_problem(session: Session, problem_hash: str) -> ProblemView:
    """Return a problem with every field written out."""
    row = session.get(ProblemRow, problem_hash)
    if row is None:
        raise UnknownRowError("problem", problem_hash)
    world = _world(world_from(row.definition))
    return ProblemView(**_item(row).model_dump(), definition=row.definition, world=world)


def _world(world: World) -> WorldView:
    return WorldView(
        center=world.center.title,
        bodies=[body.title for body in world.bodies],
        length_km=world.units.lu_km,
        time_days=world.units.tu_days,
        mass_kg=world.units.mu_kg,
        strict=ToleranceView(**asdict(world.strict)),
        loose=ToleranceView(**asdict(world.loose)),
    )


def _item(row: ProblemRow) -> ProblemItem:
    outages = [OutageView(**outage) for outage in row.definition["outages"]]
    return ProblemItem(hash=row.hash, k=row.k, outages=outages, n_segments=row.n_segments)


def list_jobs(
    session: Session, campaign: int | None, search: str | None, state: str | None, limit: int, after: int
) -> JobPage:
    """Return a page of jobs in order of id."""
    query = _jobs().where(JobRow.id > after).order_by(JobRow.id).limit(limit + 1)
    if state is not None:
        is_in(state)
    if campaign is not None or search is not None or state is not None:
        query = query.where(JobRow.id.in_(_next_of_each(campaign, search, state, limit + 1, after)))
    jobs = [_job(*row) for row in session.execute(query)]
    return JobPage(items=jobs[:limit], next=jobs[limit - 1].id if len(jobs) > limit else None)


def _next_of_each(
    campaign: int | None, search: str | None, state: str | None, number: int, after: int
) -> Select[int]:
    """Return the next jobs of each search in each state, among which are the next of all of them.

    A search has its jobs by state in an index; without it one page might take a walk over all jobs.
    """
    names = JOB_STATES if state is None else (state,)
    states = union_all(*(select(literal(name).label("state")) for name in names)).subquery("wanted")
    following = (
        select(_Next.id)
        .where(_Next.search_id == SearchRow.id, _Next.state == states.c.state, _Next.id > after)
        .order_by(_Next.id)
        .limit(number)
        .correlate(SearchRow, states)
    )
    found = select(_Each.id).select_from(SearchRow).join(states, true()).join(_Each, _Each.id.in_(following))
    if campaign is not None:
        found = found.where(SearchRow.campaign_id == campaign)
    return found if search is None else found.where(SearchRow.name == search)


def is_in(state: str) -> ColumnElement[bool]:
    """Return the condition that a job is in a state, as text: only then is the index of that state used."""
    if state not in JOB_STATES:
        raise StoreError(f"state: expected one of {', '.join(JOB_STATES)}, got {state!r}")
    return JobRow.state == literal_column(f"'{state}'")


def get_job(session: Session, job_id: int) -> JobView:
    """Return a job."""
    found = session.execute(_jobs().where(JobRow.id == job_id)).first()
    if found is None:
        raise UnknownRowError("job", job_id)
    return _job(*found)


def _jobs() -> Select[JobRow, int, str, str | None]:
    is_last = (AttemptRow.job_id == JobRow.id) & (AttemptRow.attempt == JobRow.attempt)
    return (
        select(JobRow, SearchRow.campaign_id, SearchRow.name, AttemptRow.error)
        .join(SearchRow, SearchRow.id == JobRow.search_id)
        .outerjoin(AttemptRow, is_last)
    )


def _job(row: JobRow, campaign_id: int, search: str, error: str | None) -> JobView:
    # The last line of a traceback names the exception, what comes before it only where.
    shown = error.strip().splitlines()[-1] if error else None
    columns = {name: getattr(row, name) for name in JobView.model_fields if name not in ELSEWHERE}
    columns["not_before"] = row.not_before or None
    return JobView(**columns, campaign_id=campaign_id, search=search, error=shown)


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
        raise UnknownRowError("job", job_id)
    query = _attempts(AttemptRow.job_id == job_id, AttemptRow.error).order_by(AttemptRow.attempt.desc())
    found = session.execute(query.limit(limit)).mappings()
    return AttemptsOfJob.model_validate({"items": list(found)})


#: What an operator may have to do something about.
OPEN = ("queued", "running", "dead")

_First = aliased(JobRow)


def get_queue(session: Session, now: float, leases: LeaseSettings) -> QueueView:
    """Return the queue as it is now."""
    by_campaign = _counts(session)
    oldest = _oldest(session)
    total = {state: sum(counts.get(state, 0) for counts in by_campaign.values()) for state in JOB_STATES}
    return QueueView.model_validate(
        {
            "at": now,
            "lease_s": leases.lease_s,
            "heartbeat_s": leases.heartbeat_s,
            "jobs": total,
            "oldest_job_id": oldest and oldest[0],
            "oldest_queued_at": oldest and oldest[1],
            "campaigns": _campaigns(session, by_campaign),
        }
    )


def _counts(session: Session) -> dict[int, dict[str, int]]:
    """Return the number of jobs by campaign and state, from what is counted as it comes."""
    owners = {row_id: owner for row_id, owner in session.execute(select(SearchRow.id, SearchRow.campaign_id))}
    found: dict[int, list[dict[str, int]]] = {}
    for search_id, counts in job_states(session, true()).items():
        found.setdefault(owners[search_id], []).append(counts)
    return {campaign_id: sum_counts(counts) for campaign_id, counts in found.items()}


def _oldest(session: Session) -> tuple[int, float] | None:
    """Return id and time of the queued job with the least id: the least of those of each search."""
    first = (
        select(_First.id)
        .where(_First.search_id == SearchRow.id, _First.state == "queued")
        .order_by(_First.id)
        .limit(1)
        .correlate(SearchRow)
    )
    ids = select(JobRow.id).select_from(SearchRow).join(JobRow, JobRow.id == first.scalar_subquery())
    query = select(JobRow.id, JobRow.updated_at).where(JobRow.id.in_(ids)).order_by(JobRow.id).limit(1)
    row = session.execute(query).first()
    return None if row is None else (row.id, row.updated_at)


def _campaigns(session: Session, by_campaign: dict[int, dict[str, int]]) -> list[dict[str, Any]]:
    wanted = [row_id for row_id, counts in by_campaign.items() if any(counts.get(name) for name in OPEN)]
    rows = session.execute(
        select(CampaignRow.id, CampaignRow.name, CampaignRow.state)
        .where(CampaignRow.id.in_(wanted))
        .order_by(CampaignRow.id.desc())
        .limit(200)
    )
    return [
        {"campaign_id": row.id, "name": row.name, "state": row.state, "jobs": by_campaign[row.id]}
        for row in rows
    ]


#: Bars or points of one picture, at most.
MOST = 5000
#: Window of attempts where none is asked for [s].
WINDOW_S = 900.0


class Activity:
    """Searches hop by hop, attempts and the queue of one archive."""

    def __init__(self, database: Database, clock: Callable[[], float], leases: LeaseSettings) -> None:
        self._database = database
        self._clock = clock
        self._leases = leases

    def search(self, campaign_id: int, name: str) -> SearchDetail:
        """Return a search of a campaign."""
        with self._database.read() as session:
            return searches.get_search(session, campaign_id, name)

    def hops(self, campaign_id: int, name: str, limit: int = MOST, after: int = 0) -> HopsView:
        """Return the solves of a search, or of whole chains of it."""
        with self._database.read() as session:
            return searches.hops_of_search(session, campaign_id, name, limit, after)

    def attempts(self, since: float | None, until: float | None, limit: int = MOST) -> AttemptPage:
        """Return the attempts of a window, which ends now and is a quarter of an hour if not told."""
        end = self._clock() if until is None else until
        begin = end - WINDOW_S if since is None else since
        with self._database.read() as session:
            return attempts_between(session, begin, end, limit)

    def attempts_of_job(self, job_id: int) -> AttemptsOfJob:
        """Return the attempts at a job."""
        with self._database.read() as session:
            return attempts_of_job(session, job_id)

    def queue(self) -> QueueView:
        """Return what waits, runs and was given up."""
        with self._database.read() as session:
            return get_queue(session, self._clock(), self._leases)
