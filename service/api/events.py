"""What happens, as it happens: server-sent events, and the same rows by request."""

import time
from collections.abc import AsyncIterator
from typing import Annotated

import anyio
from fastapi import APIRouter, Depends, Header, Query, Request
from fastapi.sse import EventSourceResponse, ServerSentEvent
from starlette.concurrency import run_in_threadpool

from service.api.context import After, CampaignWanted, Id, Limit, StoreHere
from service.api.schemas import EventPage, EventView
from service.store import Store

router = APIRouter(tags=["events"])

#: How often a stream looks for new rows [s].
POLL_S = 0.5
#: A stream ends after this time, and the browser comes back with its last id [s].
LIFETIME_S = 600.0

LastEventId = Annotated[int | None, Header(ge=0, lt=2**63, description="Id after which to go on")]


@router.get("/events")
def list_events(
    store: StoreHere, after: After = 0, campaign: CampaignWanted = None, limit: Limit = 200
) -> EventPage:
    """Return the events that follow an id, the oldest first."""
    return EventPage(items=store.events(after, campaign, limit))


def _campaign_exists(campaign_id: Id, store: StoreHere) -> Id:
    # Before the stream begins, since afterwards there is no status left to send.
    store.campaign(campaign_id)
    return campaign_id


@router.get("/campaigns/{campaign_id}/events", response_class=EventSourceResponse)
async def follow_campaign(
    campaign_id: Annotated[int, Depends(_campaign_exists)],
    store: StoreHere,
    request: Request,
    after: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
    last_event_id: LastEventId = None,
) -> AsyncIterator[ServerSentEvent]:
    """Stream the events of a campaign; `data` is an event, its id is the id to resume after.

    Without a place to resume, the stream begins with the latest event: whoever reads the campaign anew at
    each event has then missed nothing between an earlier reading and the start of the stream.
    """
    last = last_event_id if last_event_id is not None else after
    if last is None:
        last = max(0, await run_in_threadpool(store.last_event_id, campaign_id) - 1)
    end = time.monotonic() + LIFETIME_S
    while time.monotonic() < end and not request.app.state.is_closing():
        for event in await run_in_threadpool(_read, store, last, campaign_id):
            last = event.id
            yield ServerSentEvent(id=str(last), data=event)
        await anyio.sleep(POLL_S)


def _read(store: Store, after: int, campaign_id: int) -> list[EventView]:
    return store.events(after, campaign_id)
