"""A campaign as a file: taken away, and brought by somebody from another installation."""

import tempfile
from collections.abc import AsyncIterator
from typing import Annotated, Any, BinaryIO

from fastapi import APIRouter, Depends, Request, Response
from fastapi.responses import StreamingResponse
from starlette.background import BackgroundTask

from service.api.context import Id, StoreHere
from service.api.jobs import CONFLICT
from service.auth.network import MAX_PORTABLE_BYTES
from service.auth.request_limits import save_body
from service.schemas.campaign import TakenInView
from service.solutions.export import ZIP
from service.store.archive_files import file_name, packed, pieces, take_in_file

router = APIRouter(tags=["campaigns"])

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
    """Give the body as a file beside the archive, which has no name there and is gone with the request."""
    with tempfile.TemporaryFile(dir=store.folder) as draft:
        await save_body(request.receive, MAX_PORTABLE_BYTES, draft)
        yield draft


@router.post(
    "/campaigns/import",
    status_code=201,
    responses={200: {"model": TakenInView}, **CONFLICT},
    openapi_extra=BODY,
)
def import_campaign(
    file: Annotated[BinaryIO, Depends(_sent)], store: StoreHere, response: Response
) -> TakenInView:
    """Take in the campaign of a portable file, all of it or nothing; what is there already stays (200)."""
    taken = take_in_file(store, file, "that was sent")
    response.status_code = 201 if taken.new_campaigns else 200
    response.headers["location"] = f"/api/v1/campaigns/{taken.campaign_id}"
    return TakenInView(**taken._asdict())
