"""What operators do to campaigns, searches and jobs: pause, resume, cancel and retry, all idempotent."""

from typing import Literal

from sqlalchemy import literal_column, select, update
from sqlalchemy.orm import Session

from service.db.tables import CampaignRow, JobRow, SearchRow
from service.db.transitions import ENDED, sources
from service.store.campaigns import get_campaign_row, get_search_row
from service.store.errors import UnknownRowError, WrongStateError
from service.store.events import add_event, add_job_event, add_search_event
from service.store.planning import advance, enter

Verb = Literal["pause", "resume", "cancel"]
STATE_AFTER = {"pause": "paused", "resume": "active", "cancel": "cancelled"}


def control_campaign(session: Session, campaign_id: int, verb: Verb, now: float) -> None:
    """Pause a campaign, let it go on, or cancel it."""
    campaign = get_campaign_row(session, campaign_id)
    state = STATE_AFTER[verb]
    if campaign.state == state:
        return
    _require("campaign", campaign_id, campaign.state, verb)
    campaign.state = state
    if verb == "cancel":
        campaign.finished_at = now
        for row in session.scalars(select(SearchRow).where(SearchRow.campaign_id == campaign_id)):
            if row.state not in ENDED:
                _cancel_search(session, row, now)
    add_event(session, campaign_id, "campaign", now, state=state)
    advance(session, campaign, now)


def control_search(session: Session, campaign_id: int, name: str, verb: Verb, now: float) -> None:
    """Pause a search, let it go on, or cancel it; searches that it feeds go on with what there is."""
    campaign, row = get_search_row(session, campaign_id, name)
    is_so = row.state in ("waiting", "active") if verb == "resume" else row.state == STATE_AFTER[verb]
    if is_so:
        return
    _require("search", name, row.state, verb)
    if verb == "cancel":
        _cancel_search(session, row, now)
    elif verb == "pause":
        enter(session, campaign, row, "paused", now)
    else:
        # Seeds that are chosen once were chosen if there are jobs.
        enter(session, campaign, row, "active" if row.n_planned else "waiting", now)
    advance(session, campaign, now)


def _cancel_search(session: Session, row: SearchRow, now: float) -> None:
    """Cancel its queued jobs and stop the running ones."""
    own = JobRow.search_id == row.id
    queued, running = own & (JobRow.state == "queued"), own & (JobRow.state == "running")
    session.execute(update(JobRow).where(queued).values(state="cancelled", updated_at=now))
    session.execute(update(JobRow).where(running).values(is_cancelling=True, updated_at=now))
    row.state = "cancelled"
    add_search_event(session, row, now)


def set_campaign(session: Session, campaign_id: int, priority: int) -> None:
    """Set the priority of a campaign."""
    get_campaign_row(session, campaign_id).priority = priority


def set_search(
    session: Session, campaign_id: int, name: str, weight: float | None, priority: int | None
) -> None:
    """Set weight or priority of a search."""
    _, row = get_search_row(session, campaign_id, name)
    row.weight = row.weight if weight is None else weight
    row.priority = row.priority if priority is None else priority


def cancel_job(session: Session, job_id: int, now: float) -> None:
    """Cancel a queued or running job; a report that still passes the fence is kept."""
    job, search, campaign = _job(session, job_id)
    if job.state == "cancelled" or job.is_cancelling:
        return
    _require("job", job_id, job.state, "cancel")
    if job.state == "running":
        job.is_cancelling, job.updated_at = True, now
        return
    job.state, job.updated_at = "cancelled", now
    add_job_event(session, search, job, now)
    advance(session, campaign, now)


def requeue_job(session: Session, job_id: int, now: float) -> None:
    """Requeue a dead or cancelled job; its count of failures is reset."""
    job, search, campaign = _job(session, job_id)
    if job.state == "queued":
        return
    _require("job", job_id, job.state, "requeue")
    # A cancelled campaign has cancelled searches alone.
    if search.state == "cancelled":
        raise WrongStateError(
            f"search {search.name}: expected a search that goes on, got one that is cancelled"
        )
    _requeue(session, [job], now)
    _open_again(session, campaign, {search.id}, now)
    session.flush()
    if job.state != "queued":
        raise WrongStateError(f"search {search.name}: expected a budget that is not used up, got one that is")
    add_job_event(session, search, job, now)


def requeue_dead_jobs(session: Session, campaign_id: int, now: float) -> int:
    """Requeue the dead jobs of a campaign, their counts of failures reset; return how many."""
    campaign = get_campaign_row(session, campaign_id)
    if campaign.state == "cancelled":
        return 0
    open_searches = select(SearchRow.id).where(
        SearchRow.campaign_id == campaign_id, SearchRow.state != "cancelled"
    )
    # Its state stands as text, since only then is the index of that state used.
    dead = (JobRow.search_id.in_(open_searches)) & (JobRow.state == literal_column("'dead'"))
    jobs = list(session.scalars(select(JobRow).where(dead)))
    if jobs:
        _requeue(session, jobs, now)
        _open_again(session, campaign, {job.search_id for job in jobs}, now)
        add_event(session, campaign_id, "campaign", now, state=campaign.state, n_requeued=len(jobs))
    return len(jobs)


def _requeue(session: Session, jobs: list[JobRow], now: float) -> None:
    for job in jobs:
        job.state, job.n_failures, job.not_before, job.updated_at = "queued", 0, 0.0, now
    session.flush()


def _open_again(session: Session, campaign: CampaignRow, search_ids: set[int], now: float) -> None:
    """Open the searches of jobs that run again, and those that they feed, which may get new seeds now."""
    rows = session.scalars(select(SearchRow).where(SearchRow.campaign_id == campaign.id))
    reopened = set(search_ids)
    # A source comes before what it feeds.
    for row in sorted(rows, key=lambda row: row.id):
        if row.state == "done" and (row.id in reopened or row.source_id in reopened):
            enter(session, campaign, row, "active" if row.id in search_ids else "waiting", now)
            reopened.add(row.id)
    if campaign.state == "done":
        campaign.state, campaign.finished_at = "active", None
        add_event(session, campaign.id, "campaign", now, state="active")
    advance(session, campaign, now)


def _job(session: Session, job_id: int) -> tuple[JobRow, SearchRow, CampaignRow]:
    job = session.get(JobRow, job_id)
    if job is None:
        raise UnknownRowError("job", job_id)
    search = session.get_one(SearchRow, job.search_id)
    return job, search, session.get_one(CampaignRow, search.campaign_id)


def _require(noun: str, name: object, state: str, verb: str) -> None:
    """Raise unless a verb can be said in a state; the changes that it makes are among those that exist."""
    if verb in ("resume", "requeue"):
        wanted = ["paused"] if verb == "resume" else ["dead", "cancelled"]
    else:
        wanted = sources(noun, STATE_AFTER[verb])
    if state not in wanted:
        raise WrongStateError(f"{noun} {name}: expected state {' or '.join(wanted)} to {verb}, got {state}")
