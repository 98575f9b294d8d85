"""An attempt that still holds its job, with all that taking back its outcome needs, read at once."""

from dataclasses import dataclass, field

from sqlalchemy import bindparam, select
from sqlalchemy.orm import Session

from service.db.tables import AttemptRow, CampaignRow, CaseRow, JobRow, SearchRow
from workers.executor import Ticket


@dataclass(slots=True)
class Held:
    """A running job and what it belongs to."""

    job: JobRow
    attempt: AttemptRow
    search: SearchRow
    campaign: CampaignRow
    problem_hash: str
    #: Searches, with their campaigns, that its solutions have given jobs.
    fed: dict[int, tuple[SearchRow, CampaignRow]] = field(default_factory=dict)


_HELD = (
    select(JobRow, AttemptRow, SearchRow, CampaignRow, CaseRow.problem_hash)
    .join(AttemptRow, (AttemptRow.job_id == JobRow.id) & (AttemptRow.attempt == JobRow.attempt))
    .join(SearchRow, SearchRow.id == JobRow.search_id)
    .join(CampaignRow, CampaignRow.id == SearchRow.campaign_id)
    .join(CaseRow, (CaseRow.search_id == JobRow.search_id) & (CaseRow.position == JobRow.case_index))
    .where(
        JobRow.id == bindparam("job_id"), JobRow.attempt == bindparam("attempt"), JobRow.state == "running"
    )
    # The fence: on PostgreSQL nobody else gets the row before this transaction ends; SQLite has one writer.
    .with_for_update(of=JobRow)
)


def find_held(session: Session, ticket: Ticket) -> Held | None:
    """Return what an attempt holds, or None where it no longer holds its job."""
    found = session.execute(_HELD, ticket._asdict()).first()
    return None if found is None else Held(*found)
