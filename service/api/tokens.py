"""Tokens and the audit, for administrators."""

from typing import Annotated

from fastapi import APIRouter, Path, Query

from service.api.context import Limit, StoreHere
from service.api.jobs import CONFLICT
from service.schemas.identity import AuditPage, NewToken, TokenPage, TokenRequest, TokenView

router = APIRouter(tags=["tokens"])

NameOrId = Annotated[str, Path(min_length=1, max_length=64, description="Name or id of a token")]
Before = Annotated[int | None, Query(ge=1, lt=2**63, description="`next` of the page before")]


@router.get("/tokens")
def list_tokens(store: StoreHere) -> TokenPage:
    """Return all tokens without their secrets, the newest first."""
    return TokenPage(items=store.identities.tokens())


@router.post("/tokens", status_code=201, responses=CONFLICT)
def create_token(wanted: TokenRequest, store: StoreHere) -> NewToken:
    """Make a token; this answer is the only one that shows it."""
    return store.identities.create(wanted.name, wanted.role, wanted.days)


@router.delete("/tokens/{name_or_id}")
def revoke_token(name_or_id: NameOrId, store: StoreHere) -> TokenView:
    """End a token and the sessions that were opened with it, at once."""
    return store.identities.revoke(name_or_id)


@router.get("/audit")
def list_audit(store: StoreHere, limit: Limit = 50, before: Before = None) -> AuditPage:
    """Return who changed something or was refused to, the newest first."""
    return store.identities.audit(limit, before)
