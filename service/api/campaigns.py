"""Routes of campaigns: submit, monitor, control, export and import."""

import tempfile
from collections.abc import AsyncIterator
from typing import Annotated, Any, BinaryIO

from fastapi import APIRouter, BackgroundTasks, Depends, Header, Path, Query, Request, Response
from fastapi.responses import StreamingResponse
from starlette.background import BackgroundTask

from service.api.context import HeavyHere, Id, StoreHere
from service.api.jobs import CONFLICT
from service.auth.network import MAX_PORTABLE_BYTES
from service.auth.request_limits import save_body
from service.schemas.campaign import CampaignCards, CampaignView, HistoryView, ImportView
from service.schemas.search import PriorityRequest, WeightRequest
from service.solutions.export import ZIP
from service.spec import spec_from
from service.spec.spec_check import require_flyable
from service.store.archive_files import file_name, import_file, packed, pieces
from service.store.store import Store

router = APIRouter(tags=["campaigns"])

Key = Annotated[str | None, Header(pattern="^[!-~]{1,200}$", description="Unique for each submission")]
SearchName = Annotated[
    str, Path(pattern="^[A-Za-z0-9][A-Za-z0-9 ._-]{0,79}$", description="Name of a search")
]

CampaignName = Annotated[str | None, Query(max_length=80, description="Name or id of the only one wanted")]


@router.post(
    "/campaigns",
    status_code=201,
    responses={200: {"model": CampaignView}, 202: {"model": CampaignView}, **CONFLICT},
)
async def submit_campaign(
    spec: dict[str, Any],
    store: StoreHere,
    heavy: HeavyHere,
    request: Request,
    response: Response,
    afterwards: BackgroundTasks,
    idempotency_key: Key = None,
) -> CampaignView:
    """Submit a campaign; the same specification again is the same campaign (200).

    A large one is answered (202) before all of its jobs are planned: a search waits until its own are.
    With an `Idempotency-Key` another specification under the same key is refused (409, `key_reused`).
    """
    view, is_new, is_planned = await heavy.run(_submit, store, spec, idempotency_key)
    response.status_code = (201 if is_planned else 202) if is_new else 200
    if not is_planned:
        # What is cut off by the end of the process, the next coordinator of the archive plans.
        afterwards.add_task(store.plan_rest, view.id, request.app.state.is_closing)
    response.headers["location"] = f"/api/v1/campaigns/{view.id}"
    return view


def _submit(store: Store, spec: dict[str, Any], key: str | None) -> tuple[CampaignView, bool, bool]:
    specification = spec_from(spec)
    require_flyable(specification.problem)
    campaign_id, is_new = store.begin_campaign(specification, key)
    return store.campaign(campaign_id), is_new, not store.unplanned(campaign_id)


@router.get("/campaigns/{campaign_id}")
def get_campaign(campaign_id: Id, store: StoreHere) -> CampaignView:
    """Return a campaign with its searches and how far they are."""
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/pause", responses=CONFLICT)
def pause_campaign(campaign_id: Id, store: StoreHere) -> CampaignView:
    """Dispatch no more jobs of a campaign; running ones finish."""
    store.control_campaign(campaign_id, "pause")
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/resume", responses=CONFLICT)
def resume_campaign(campaign_id: Id, store: StoreHere) -> CampaignView:
    """Resume a paused campaign."""
    store.control_campaign(campaign_id, "resume")
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/cancel", responses=CONFLICT)
def cancel_campaign(campaign_id: Id, store: StoreHere) -> CampaignView:
    """Cancel a campaign for good and stop its running jobs; all results are kept."""
    store.control_campaign(campaign_id, "cancel")
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/priority")
def set_campaign_priority(campaign_id: Id, wanted: PriorityRequest, store: StoreHere) -> CampaignView:
    """Set the priority of a campaign; lower goes first, 0 is the default."""
    store.set_campaign(campaign_id, priority=wanted.priority)
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/searches/{name}/pause", responses=CONFLICT)
def pause_search(campaign_id: Id, name: SearchName, store: StoreHere) -> CampaignView:
    """Dispatch no more jobs of a search; running ones finish."""
    store.control_search(campaign_id, name, "pause")
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/searches/{name}/resume", responses=CONFLICT)
def resume_search(campaign_id: Id, name: SearchName, store: StoreHere) -> CampaignView:
    """Resume a paused search."""
    store.control_search(campaign_id, name, "resume")
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/searches/{name}/cancel", responses=CONFLICT)
def cancel_search(campaign_id: Id, name: SearchName, store: StoreHere) -> CampaignView:
    """Cancel a search for good; searches that it seeds go on with what it has found."""
    store.control_search(campaign_id, name, "cancel")
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/searches/{name}/weight")
def set_search_weight(
    campaign_id: Id, name: SearchName, wanted: WeightRequest, store: StoreHere
) -> CampaignView:
    """Set the share of the workers that a search gets among searches of equal priority."""
    store.set_search(campaign_id, name, weight=wanted.weight)
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/searches/{name}/priority")
def set_search_priority(
    campaign_id: Id, name: SearchName, wanted: PriorityRequest, store: StoreHere
) -> CampaignView:
    """Set the priority of a search; lower goes first, -k is the default of S(k|k')."""
    store.set_search(campaign_id, name, priority=wanted.priority)
    return store.campaign(campaign_id)


#: How the OpenAPI document describes the file.
PORTABLE = {"schema": {"type": "string", "format": "binary"}, "example": "PK..."}
BODY: dict[str, Any] = {"requestBody": {"required": True, "content": {ZIP: PORTABLE}}}


@router.get(
    "/campaigns/{campaign_id}/export",
    response_class=StreamingResponse,
    responses={200: {"content": {ZIP: PORTABLE}}, **CONFLICT},
)
def export_campaign(campaign_id: Id, store: StoreHere) -> StreamingResponse:
    """Return a campaign that is paused or has ended, and those that seed it, as one portable file."""
    name = file_name(store.campaign(campaign_id).name)
    draft = packed(store, campaign_id, store.folder)
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return StreamingResponse(
        pieces(draft), media_type=ZIP, headers=headers, background=BackgroundTask(draft.close)
    )


async def _sent(request: Request, store: StoreHere) -> AsyncIterator[BinaryIO]:
    """Yield the request body as an unnamed temporary file beside the archive."""
    with tempfile.TemporaryFile(dir=store.folder) as draft:
        await save_body(request.receive, MAX_PORTABLE_BYTES, draft)
        yield draft


@router.post(
    "/campaigns/import",
    status_code=201,
    responses={200: {"model": ImportView}, **CONFLICT},
    openapi_extra=BODY,
)
def import_campaign(
    file: Annotated[BinaryIO, Depends(_sent)], store: StoreHere, response: Response
) -> ImportView:
    """Import the campaign of a portable file, all or nothing; what is there already stays (200)."""
    taken = import_file(store, file, "that was sent")
    response.status_code = 201 if taken.new_campaigns else 200
    response.headers["location"] = f"/api/v1/campaigns/{taken.campaign_id}"
    return ImportView(**taken._asdict())


@router.get("/campaigns")
def list_campaigns(store: StoreHere, name: CampaignName = None) -> CampaignCards:
    """Return the newest 200 campaigns, each with how far it is and what it has found.

    With `name` only one, however old it is: the newest of this name, or else that of this id.
    """
    return CampaignCards(items=store.campaign_cards(name))


@router.get("/campaigns/{campaign_id}/history")
def get_history(campaign_id: Id, store: StoreHere) -> HistoryView:
    """Return improvements, outcomes over time, seeds and delta-v of a campaign, finished or not.

    `n_read` is smaller than `n_solves` for a few requests after a start, while a large archive is read.
    """
    return store.campaign_history(campaign_id)
