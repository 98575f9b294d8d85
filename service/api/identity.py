"""Sessions: a token exchanged for a cookie; and, for administrators, tokens and the audit log."""

import re
from typing import Annotated
from urllib.parse import parse_qs

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse

from service.api.context import AccessHere, IdentityHere, Limit, StoreHere
from service.api.jobs import CONFLICT
from service.dashboard.assets import page
from service.schemas.identity import (
    AuditPage,
    NewToken,
    SessionView,
    SignIn,
    TokenPage,
    TokenRequest,
    TokenView,
)
from service.store.identity import COOKIE, RefusedTokenError
from service.store.store import Store

router = APIRouter(tags=["session"])
pages = APIRouter(include_in_schema=False)

#: Where to go after signing in: a path of ours, never another site.
_OWN_PATH = re.compile(r"/(?![/\\])[^\x00-\x20\\]*")
Next = Annotated[str, Query(max_length=2048)]


@router.post("/session", status_code=201)
def sign_in(wanted: SignIn, request: Request, response: Response, store: StoreHere) -> SessionView:
    """Exchange a token for a session cookie."""
    return _open_session(store, request, response, wanted.token.get_secret_value())


@router.get("/session")
def get_session(identity: IdentityHere) -> SessionView:
    """Return the identity of the client."""
    return SessionView(name=identity.name, role=identity.role)


@router.delete("/session", status_code=204)
def sign_out(request: Request, response: Response, store: StoreHere) -> None:
    """End the session of the cookie; idempotent."""
    _close_session(store, request, response)


async def _form(request: Request) -> dict[str, str]:
    body = (await request.body()).decode("utf-8", errors="replace")
    return {name: values[0] for name, values in parse_qs(body, max_num_fields=10).items()}


Form = Annotated[dict[str, str], Depends(_form)]


@pages.get("/sign-in", response_class=HTMLResponse)
def sign_in_page(access: AccessHere, next: Next = "/") -> Response:
    """Return the sign-in page, or redirect where no token is needed."""
    if access.is_open:
        return RedirectResponse(_own(next), status_code=303)
    return _page(_own(next), "", 200)


@pages.post("/sign-in", response_class=HTMLResponse)
def send_sign_in(form: Form, request: Request, store: StoreHere) -> Response:
    """Sign in, and go to the page that was asked for."""
    target = _own(form.get("next", "/"))
    answer = RedirectResponse(target, status_code=303)
    try:
        _open_session(store, request, answer, form.get("token", "").strip())
    except RefusedTokenError as error:
        return _page(target, str(error), 401)
    return answer


@pages.post("/sign-out", response_class=HTMLResponse)
def send_sign_out(request: Request, store: StoreHere) -> Response:
    """Sign out, and ask for a token again."""
    answer = RedirectResponse("/sign-in", status_code=303)
    _close_session(store, request, answer)
    return answer


def _open_session(store: Store, request: Request, response: Response, written: str) -> SessionView:
    value, lifetime_s, identity = store.identities.sign_in(written)
    # For the audit, which knows by now only that nobody asked for a session.
    request.state.identity = identity
    is_https = request.url.scheme == "https"
    response.set_cookie(
        COOKIE, value, max_age=int(lifetime_s), httponly=True, samesite="strict", secure=is_https
    )
    response.headers["cache-control"] = "no-store"
    return SessionView(name=identity.name, role=identity.role)


def _close_session(store: Store, request: Request, response: Response) -> None:
    if (value := request.cookies.get(COOKIE)) is not None:
        store.identities.sign_out(value)
    response.delete_cookie(COOKIE, httponly=True, samesite="strict", secure=request.url.scheme == "https")


def _page(target: str, complaint: str, status: int) -> Response:
    headers = {"Cache-Control": "no-store"}
    if status == 401:
        headers["WWW-Authenticate"] = 'Bearer realm="coastarc"'
    html = page("sign_in.html", next=target, complaint=complaint)
    return HTMLResponse(html, status_code=status, headers=headers)


def _own(target: str) -> str:
    return target if _OWN_PATH.fullmatch(target) else "/"


tokens_router = APIRouter(tags=["tokens"])

NameOrId = Annotated[str, Path(min_length=1, max_length=64, description="Name or id of a token")]
Before = Annotated[int | None, Query(ge=1, lt=2**63, description="`next` of the page before")]


@tokens_router.get("/tokens")
def list_tokens(store: StoreHere) -> TokenPage:
    """Return all tokens without their secrets, the newest first."""
    return TokenPage(items=store.identities.tokens())


@tokens_router.post("/tokens", status_code=201, responses=CONFLICT)
def create_token(wanted: TokenRequest, store: StoreHere) -> NewToken:
    """Make a token; this answer is the only one that shows it."""
    return store.identities.create(wanted.name, wanted.role, wanted.days)


@tokens_router.delete("/tokens/{name_or_id}")
def revoke_token(name_or_id: NameOrId, store: StoreHere) -> TokenView:
    """Revoke a token and the sessions opened with it, at once."""
    return store.identities.revoke(name_or_id)


@tokens_router.get("/audit")
def list_audit(store: StoreHere, limit: Limit = 50, before: Before = None) -> AuditPage:
    """Return the audit log, the newest first."""
    return store.identities.audit(limit, before)
