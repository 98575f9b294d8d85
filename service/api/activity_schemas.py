"""The JSON of what is being worked on: attempts, the queue, and what waits in it."""

from datetime import datetime
from typing import Literal

from service.api.schemas import Answer, CampaignState, Ending, JobCounts


class AttemptView(Answer):
    """One dispatch of a job."""

    job_id: int
    attempt: int
    worker: str
    campaign_id: int
    search: str
    strategy: str
    kind: Literal["hop", "map"]
    started_at: datetime
    #: None while it runs.
    ended_at: datetime | None
    ending: Ending | None


class AttemptPage(Answer):
    """The attempts of a window of time: all, or a part that is drawn evenly, in order of their start."""

    since: datetime
    until: datetime
    items: list[AttemptView]
    n_all: int


class AttemptDetail(AttemptView):
    """An attempt with all that is known about what went wrong."""

    error: str | None


class AttemptsOfJob(Answer):
    """The attempts at a job, the latest first."""

    items: list[AttemptDetail]


class QueueItem(Answer):
    """The jobs of a campaign that has some."""

    campaign_id: int
    name: str
    state: CampaignState
    jobs: JobCounts


class QueueView(Answer):
    """What waits, runs and was given up, and the clock by which leases end."""

    at: datetime
    #: A lease ends so long after the last heartbeat.
    lease_s: float
    heartbeat_s: float
    jobs: JobCounts
    #: In the queue for longest.
    oldest_job_id: int | None
    oldest_queued_at: datetime | None
    #: Campaigns with jobs that wait, run or were given up, the newest first.
    campaigns: list[QueueItem]


class Requeued(Answer):
    """How many jobs were put back into the queue."""

    n_jobs: int
