"""An attempt that still holds its job, with all that taking back its outcome needs, read at once."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import bindparam, select, tuple_
from sqlalchemy.orm import Session

from service.db.tables import AttemptRow, CampaignRow, CaseRow, JobRow, SearchRow
from service.store.errors import OtherClaimant
from workers.executor import Ticket


@dataclass(slots=True)
class Held:
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


def find_held(
    session: Session, tickets: Sequence[Ticket], by: str | None = None, state: str = "running"
) -> dict[Ticket, Held]:
    """Return what attempts hold; those that no longer hold their jobs are not among them.

    One that another token claimed than the one named, if any is, is refused.  With the state `queued`, those
    whose jobs went back to the queue and have been handed to nobody since.
    """
    wanted = {
        "state": state,
        "job_ids": [ticket.job_id for ticket in tickets],
        "tickets": [tuple(ticket) for ticket in tickets],
    }
    found = [Held(*row) for row in session.execute(_HELD, wanted)]
    for held in found:
        require_claimant(held.attempt, by)
    return {Ticket(held.job.id, held.job.attempt): held for held in found}


def require_claimant(attempt: AttemptRow, by: str | None) -> None:
    """Refuse a token that did not claim an attempt."""
    if by is not None and attempt.claimed_by not in (None, by):
        raise OtherClaimant(
            f"job {attempt.job_id}: expected the token that claimed attempt {attempt.attempt}, got {by}; "
            f"report with the token that claimed, or with one of the same name"
        )
