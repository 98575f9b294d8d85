"""The web pages and their files: HTML for people, where the rest of the service speaks JSON.

Data reaches a page through the same API as everybody else; nothing here reads the store.  The headers
that guard a page are those of every answer, `service.auth.network`.
"""

from collections.abc import Callable

from fastapi import APIRouter, HTTPException, Request, Response
from fastapi.responses import HTMLResponse

from service.api.context import IdentityHere
from service.dashboard import assets
from service.dashboard.assets import SECTIONS, VIEWS, View, page

#: The name of an asset changes with its content, so a browser never has to ask again.
ASSET_HEADERS = {"Cache-Control": "public, max-age=31536000, immutable", "Vary": "Accept-Encoding"}

router = APIRouter(include_in_schema=False)


def _shell(view: View) -> Callable[[IdentityHere], HTMLResponse]:
    def answer(identity: IdentityHere) -> HTMLResponse:
        # Nobody can sign out of an open service, nor of a token.
        signed_in_as = identity.name if identity.is_cookie else None
        modules = assets.modules_of(f"views/{view.name}.js")
        html = page(
            f"views/{view.name}.html",
            view=view,
            modules=modules,
            sections=SECTIONS,
            signed_in_as=signed_in_as,
        )
        return HTMLResponse(html, headers={"Cache-Control": "no-cache"})

    return answer


for _view in VIEWS:
    # Which campaign or solution it shows is in its address, which its module reads.
    router.add_api_route(_view.path, _shell(_view), response_class=HTMLResponse, name=f"page_{_view.name}")


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
