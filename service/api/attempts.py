"""What is being worked on, and what waits: attempts by time, the attempts at a job, the queue."""

from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, HTTPException, Query

from service.api.context import Id, StoreHere
from service.schemas.job import AttemptPage, AttemptsOfJob, QueueView, Requeued
from service.store.jobs import MOST

router = APIRouter(tags=["jobs"])

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
    """Give all dead jobs of a campaign another attempt, their failures forgotten; tell how many those are."""
    return Requeued(n_jobs=store.revive(campaign_id))


def _seconds(moment: datetime | None) -> float | None:
    if moment is None:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
