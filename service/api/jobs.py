"""Routes of jobs: their states, the calls of workers, operators' actions, attempts and the queue."""

from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Query

from service.api.context import After, CampaignWanted, Id, IdentityHere, Limit, SearchWanted, StoreHere
from service.schemas.answer import Fault
from service.schemas.job import (
    AttemptPage,
    AttemptsOfJob,
    JobPage,
    JobState,
    JobView,
    QueueView,
    Requeued,
    WorkerPage,
)
from service.store.jobs import MOST
from workers.messages import (
    ClaimAnswer,
    ClaimRequest,
    CompleteAnswer,
    CompleteManyAnswer,
    CompleteManyRequest,
    CompleteRequest,
    HandInAnswer,
    HandInRequest,
    HeartbeatAnswer,
    HeartbeatRequest,
)

router = APIRouter(tags=["jobs"])

#: What the routes of workers may answer besides the usual refusals.
CONFLICT: dict[int | str, dict[str, Any]] = {409: {"model": Fault, "description": "Conflict; see `code`"}}


@router.get("/jobs")
def list_jobs(
    store: StoreHere,
    campaign: CampaignWanted = None,
    search: SearchWanted = None,
    state: JobState | None = None,
    limit: Limit = 50,
    after: After = 0,
) -> JobPage:
    """Return jobs in order of id."""
    return store.jobs(campaign, search, state, limit, after)


@router.get("/jobs/{job_id}")
def get_job(job_id: Id, store: StoreHere) -> JobView:
    """Return a job."""
    return store.job(job_id)


@router.post("/jobs/claim", responses=CONFLICT)
def claim_jobs(
    request: ClaimRequest,
    store: StoreHere,
    who: IdentityHere,
) -> ClaimAnswer:
    """Hand out up to `n_jobs` jobs, which are the worker's for the time of a lease.

    Workers with another code version or Python minor version are refused (409, `worker_refused`).
    """
    claims = store.claim(request.worker, request.n_jobs, request.campaign_id, who.name)
    return ClaimAnswer(
        claims=tuple(claims), lease_s=store.leases.lease_s, heartbeat_s=store.leases.heartbeat_s
    )


@router.post("/jobs/heartbeat", responses=CONFLICT)
def keep_jobs(
    request: HeartbeatRequest,
    store: StoreHere,
    who: IdentityHere,
) -> HeartbeatAnswer:
    """Renew the leases of a worker; return which jobs to cancel, and which leases are lost.

    With `extend` false it only tells, and writes nothing: between two heartbeats a worker so hears at once
    of what is cancelled.  What another token claimed counts as lost.
    """
    held = [job.ticket for job in request.held]
    if request.extend:
        return store.heartbeat(request.worker, held, who.name)
    return store.look(held, who.name)


@router.post("/jobs/hand-in", responses=CONFLICT)
def hand_in_hops(
    request: HandInRequest,
    store: StoreHere,
    who: IdentityHere,
) -> HandInAnswer:
    """Take the hops of a chain that goes on, so that the loss of its worker costs one hop and not the chain.

    Solves and solutions are stored as those of an outcome are, and the next attempt begins after them.
    """
    return store.hand_in(request, who.name)


@router.post("/jobs/complete", responses=CONFLICT)
def complete_job(
    request: CompleteRequest,
    store: StoreHere,
    who: IdentityHere,
) -> CompleteAnswer:
    """Record an outcome; the same report again gets the same answer.

    An attempt that no longer holds the job changes nothing (409, `stale_attempt`), nor does a report with
    another token than the one that claimed (403, `other_claimant`), nor an outcome that no run of the job
    can have had (422, which names the field).  One whose lease ran out is taken all the same if it brings a
    result and nobody has claimed the job since.
    """
    return store.complete_many([request], who.name)[0]


@router.post("/jobs/complete-many", responses=CONFLICT)
def complete_jobs(
    request: CompleteManyRequest,
    store: StoreHere,
    who: IdentityHere,
) -> CompleteManyAnswer:
    """Record several outcomes at once, which costs less than one by one.

    If one of them is refused, none is stored; sent one by one, the others are taken.
    """
    return CompleteManyAnswer(answers=tuple(store.complete_many(request.reports, who.name)))


@router.post("/jobs/{job_id}/cancel", responses=CONFLICT)
def cancel_job(job_id: Id, store: StoreHere) -> JobView:
    """Cancel a queued or running job; a result that still arrives is kept."""
    store.cancel_job(job_id)
    return store.job(job_id)


@router.post("/jobs/{job_id}/requeue", responses=CONFLICT)
def requeue_job(job_id: Id, store: StoreHere) -> JobView:
    """Requeue a dead or cancelled job; its count of failures is reset."""
    store.requeue_job(job_id)
    return store.job(job_id)


@router.get("/workers")
def list_workers(store: StoreHere) -> WorkerPage:
    """Return the workers that have registered, those seen last first, with the jobs that they hold."""
    return store.workers()


Moment = Annotated[datetime | None, Query(description="UTC unless it names its offset")]


@router.get("/attempts")
def list_attempts(
    store: StoreHere,
    since: Moment = None,
    until: Moment = None,
    limit: Annotated[int, Query(ge=1, le=MOST)] = MOST,
) -> AttemptPage:
    """Return the attempts that were going on between two moments, by default in the last quarter of an hour.

    If there are more than `limit`, those that run are all there and others are drawn evenly, the same ones
    each time; `n_all` says of how many.
    """
    begin, end = _seconds(since), _seconds(until)
    if begin is not None and end is not None and begin > end:
        raise HTTPException(422, detail=f"since: expected a moment before until, got {since}")
    return store.activity.attempts(begin, end, limit)


@router.get("/jobs/{job_id}/attempts")
def list_attempts_of_job(job_id: Id, store: StoreHere) -> AttemptsOfJob:
    """Return the latest attempts at a job, with tracebacks in full."""
    return store.activity.attempts_of_job(job_id)


@router.get("/queue")
def get_queue(store: StoreHere) -> QueueView:
    """Return how many jobs wait, run and were given up, by campaign, and how long one has waited."""
    return store.activity.queue()


@router.post("/campaigns/{campaign_id}/requeue")
def requeue_dead(campaign_id: Id, store: StoreHere) -> Requeued:
    """Requeue all dead jobs of a campaign, their counts of failures reset; return how many."""
    return Requeued(n_jobs=store.requeue_dead_jobs(campaign_id))


def _seconds(moment: datetime | None) -> float | None:
    if moment is None:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
