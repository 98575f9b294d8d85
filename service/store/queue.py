"""The queue: how many jobs wait, run or were given up, where, and since when."""

from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.api.activity_schemas import QueueView
from service.db.tables import JOB_STATES, CampaignRow, JobRow, SearchRow
from service.scheduler.leases import LeaseSettings
from service.store.catalogue import is_in

#: What an operator may have to do something about.
OPEN = ("queued", "running", "dead")


def get_queue(session: Session, now: float, leases: LeaseSettings) -> QueueView:
    """Return the queue as it is now."""
    by_campaign = _counts(session)
    oldest = session.execute(
        select(JobRow.id, JobRow.updated_at).where(is_in("queued")).order_by(JobRow.id).limit(1)
    ).first()
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
    """Return the number of jobs by campaign and state, counted in an index."""
    by_search = select(JobRow.search_id, JobRow.state, func.count()).group_by(JobRow.search_id, JobRow.state)
    owners = {row_id: owner for row_id, owner in session.execute(select(SearchRow.id, SearchRow.campaign_id))}
    found: dict[int, dict[str, int]] = {}
    for search_id, state, number in session.execute(by_search):
        counts = found.setdefault(owners[search_id], {})
        counts[state] = counts.get(state, 0) + number
    return found


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
