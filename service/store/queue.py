"""The queue: how many jobs wait, run or were given up, where, and since when."""

from typing import Any

from sqlalchemy import select, true
from sqlalchemy.orm import Session, aliased

from service.db.tables import JOB_STATES, CampaignRow, JobRow, SearchRow
from service.scheduler.plan import LeaseSettings
from service.schemas.job import QueueView
from service.store.tallies import job_states, summed

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
    return {campaign_id: summed(counts) for campaign_id, counts in found.items()}


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
