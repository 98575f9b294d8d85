"""Jobs as the API shows them: attempts, the queue, workers and events."""

from datetime import datetime
from typing import Any, Literal

from service.schemas.answer import Answer, CampaignState
from service.schemas.search import JobCounts
from workers.messages import Ending

JobState = Literal["queued", "running", "done", "dead", "cancelled"]


class JobView(Answer):
    """A job: a block of hops of one chain, or one seed mapped and solved."""

    id: int
    campaign_id: int
    search_id: int
    #: Its name.
    search: str
    kind: Literal["hop", "map"]
    state: JobState
    attempt: int
    n_failures: int
    #: Waits until then after a failure.
    not_before: datetime | None
    #: Who holds it, and until when if it sends no heartbeat.
    worker: str | None
    lease_until: datetime | None
    #: To be stopped by its worker.
    is_cancelling: bool
    ending: Ending | None
    #: The first line of what went wrong, for endings `error` and `crash`.
    error: str | None
    n_hops: int
    seed_id: str | None
    created_at: datetime
    updated_at: datetime


class JobPage(Answer):
    """Jobs in order of id; `next` is the `after` of the next page."""

    items: list[JobView]
    next: int | None


class HeldView(Answer):
    """A job that a worker holds."""

    job_id: int
    attempt: int
    lease_until: datetime


class WorkerView(Answer):
    """A dispatcher with its executor, as it described itself last."""

    name: str
    host: str
    executor: str
    slots: int
    code_version: str
    python_version: str
    #: Processors that its processes keep busy, and their memory, where it measures that.
    cpu_cores: float | None
    memory_bytes: int | None
    #: All that its machine has.
    host_memory_bytes: int | None
    created_at: datetime
    seen_at: datetime
    #: Whether it was seen within the time of a lease.
    is_alive: bool
    held: list[HeldView]


class WorkerPage(Answer):
    """Workers, those seen last first."""

    items: list[WorkerView]


class EventView(Answer):
    """Something that happened; `id` grows."""

    id: int
    campaign_id: int
    kind: Literal["job", "solution", "search", "campaign"]
    created_at: datetime
    data: dict[str, Any]


class EventPage(Answer):
    """Events in order of id."""

    items: list[EventView]


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
