"""Events: server-sent as they happen, and the same rows by request."""

import time
from collections.abc import AsyncIterator
from typing import Annotated, Any

import anyio
from fastapi import APIRouter, Depends, Header, Query, Request
from fastapi.sse import EventSourceResponse, ServerSentEvent
from starlette.concurrency import run_in_threadpool

from service.api.context import After, CampaignWanted, Id, Limit, StoreHere
from service.db.errors import UnavailableError
from service.schemas.job import EventPage
from service.store.store import Store

router = APIRouter(tags=["events"])

#: How often a stream looks for new rows [s].
POLL_S = 0.5
#: A stream ends after this time, and the browser comes back with its last id [s].
LIFETIME_S = 600.0
#: How long the browser waits before it comes back [ms].
RETRY_MS = 2000
#: Events read at once.
PAGE = 200
EXAMPLE = 'id: 42\ndata: {"id":42,"campaign_id":1,"kind":"search","data":{"state":"done"}}\n\n'

LastEventId = Annotated[int | None, Header(ge=0, lt=2**63, description="Id after which to go on")]


@router.get("/events")
def list_events(
    store: StoreHere, after: After = 0, campaign: CampaignWanted = None, limit: Limit = PAGE
) -> EventPage:
    """Return the events that follow an id, the oldest first."""
    return EventPage(items=store.events(after, campaign, limit))


def _latest(store: StoreHere) -> int:
    # Before a stream begins, since afterwards there is no status left to send.
    return store.last_event_id(None)


def _latest_of_campaign(campaign_id: Id, store: StoreHere) -> int:
    store.campaign(campaign_id)
    return store.last_event_id(campaign_id)


_STREAM: dict[int | str, dict[str, Any]] = {200: {"content": {"text/event-stream": {"example": EXAMPLE}}}}


class Resume:
    """Where a stream goes on."""

    def __init__(
        self,
        after: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
        last_event_id: LastEventId = None,
    ) -> None:
        self.after = last_event_id if last_event_id is not None else after


ResumeAt = Annotated[Resume, Depends()]


@router.get("/events/stream", response_class=EventSourceResponse, responses=_STREAM)
async def follow_all(
    latest: Annotated[int, Depends(_latest)], store: StoreHere, request: Request, resume: ResumeAt
) -> AsyncIterator[ServerSentEvent]:
    """Stream the events of all campaigns, as that of one campaign does."""
    async for event in _stream(store, request, None, resume, latest):
        yield event


@router.get("/campaigns/{campaign_id}/events", response_class=EventSourceResponse, responses=_STREAM)
async def follow_campaign(
    campaign_id: Id,
    latest: Annotated[int, Depends(_latest_of_campaign)],
    store: StoreHere,
    request: Request,
    resume: ResumeAt,
) -> AsyncIterator[ServerSentEvent]:
    """Stream the events of a campaign; `data` is an event, its id is the id to resume after.

    Without a place to resume, the stream begins with the latest event: whoever reads the campaign anew at
    each event has then missed nothing between an earlier reading and the start of the stream.
    """
    async for event in _stream(store, request, campaign_id, resume, latest):
        yield event


async def _stream(
    store: Store, request: Request, campaign_id: int | None, resume: Resume, latest: int
) -> AsyncIterator[ServerSentEvent]:
    # Ids beyond the latest come from before a backup was restored; waiting for them would be waiting long.
    last = max(0, latest - 1) if resume.after is None else min(resume.after, latest)
    yield ServerSentEvent(retry=RETRY_MS)
    end = time.monotonic() + LIFETIME_S
    while time.monotonic() < end and not request.app.state.is_closing():
        try:
            events = await run_in_threadpool(store.events, last, campaign_id, PAGE)
        except UnavailableError as error:
            # A browser comes back after a stream that broke, but not after a refusal: so the stream stays.
            store.downtime.tell(error)
            events = []
        for event in events:
            last = event.id
            yield ServerSentEvent(id=str(last), data=event)
        if len(events) < PAGE:
            await anyio.sleep(POLL_S)
