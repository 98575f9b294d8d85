"""Roles, tokens, sessions and the audit as the API shows them."""

from datetime import datetime
from enum import StrEnum
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, SecretStr

from service.schemas.answer import Answer


class Role(StrEnum):
    """What a token is for."""

    #: Reads everything but tokens and the audit.
    VIEWER = "viewer"
    #: Submits campaigns and steers them, too.
    SUBMITTER = "submitter"
    #: Does everything.
    ADMIN = "admin"
    #: Works on jobs.
    WORKER = "worker"


#: How long a token may live at most [d].
MAX_DAYS = 3650.0
TokenName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 ._@-]{0,63}$")]
Days = Annotated[float, Field(gt=0, le=MAX_DAYS, allow_inf_nan=False)]


class TokenRequest(BaseModel):
    """A token to be made."""

    model_config = ConfigDict(extra="forbid")

    name: TokenName
    role: Role
    #: After which it ends [d].
    days: Days = 90.0


class TokenView(Answer):
    """A token without its secret."""

    id: str
    name: str
    role: Role
    state: str
    created_at: datetime
    expires_at: datetime
    revoked_at: datetime | None
    last_used_at: datetime | None


class NewToken(TokenView):
    """A token in the only answer that ever shows it."""

    token: str


class TokenPage(Answer):
    """All tokens, the newest first."""

    items: list[TokenView]


class SignIn(BaseModel):
    """A token to be traded for a cookie."""

    model_config = ConfigDict(extra="forbid")

    token: SecretStr


class SessionView(Answer):
    """Who one is signed in as."""

    name: str
    role: Role


class AuditView(Answer):
    """A request that changed something, or was refused to."""

    id: int
    created_at: datetime
    actor: str
    token_id: str | None
    address: str
    method: str
    path: str
    status: int


class AuditPage(Answer):
    """A page of the audit, the newest first; `next` is the `before` of the following page."""

    items: list[AuditView]
    next: int | None
