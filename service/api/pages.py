"""The web page and its files: HTML for people, where the rest of the service speaks JSON.

Data reaches the page through the same API as everybody else; nothing here reads the store.  The headers
that guard the page are those of every answer, `service.security`.
"""

from fastapi import APIRouter, HTTPException, Request, Response
from fastapi.responses import HTMLResponse

from service.api.context import IdentityHere
from service.dashboard import assets
from service.dashboard.render import page

#: The name of an asset changes with its content, so a browser never has to ask again.
ASSET_HEADERS = {"Cache-Control": "public, max-age=31536000, immutable", "Vary": "Accept-Encoding"}

router = APIRouter(include_in_schema=False)


@router.get("/", response_class=HTMLResponse)
def live_page(identity: IdentityHere) -> HTMLResponse:
    """Return the live page; which campaign and solution it shows is in its address."""
    # Nobody can sign out of an open service, nor of a token.
    html = page("live.html", signed_in_as=identity.name if identity.is_cookie else None)
    return HTMLResponse(html, headers={"Cache-Control": "no-cache"})


@router.get("/static/{path:path}")
def asset(path: str, request: Request) -> Response:
    """Return a file of the page, compressed where the browser takes it."""
    found = assets.find(path)
    if found is None:
        raise HTTPException(404, detail=f"static file: expected one that this version has, got {path}")
    if "gzip" in request.headers.get("accept-encoding", ""):
        zipped = ASSET_HEADERS | {"Content-Encoding": "gzip"}
        return Response(found.zipped, media_type=found.media_type, headers=zipped)
    return Response(found.plain, media_type=found.media_type, headers=ASSET_HEADERS)
