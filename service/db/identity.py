"""The tables of who may do what, and of who did."""

from sqlalchemy import CheckConstraint, ForeignKey, Index, text
from sqlalchemy.orm import Mapped, mapped_column

from service.db.tables import Base
from service.schemas.identity import Role

_STRICT = {"sqlite_strict": True}
_ROLES = ", ".join(f"'{role.value}'" for role in Role)
_IN_USE = text("revoked_at IS NULL")


class TokenRow(Base):
    """A token without its secret, of which only the hash is here."""

    __tablename__ = "token"
    __table_args__ = (
        CheckConstraint(f"role IN ({_ROLES})", name="known_role"),
        # A name may be given again when its token is revoked.
        Index("token_name", "name", unique=True, sqlite_where=_IN_USE, postgresql_where=_IN_USE),
        _STRICT,
    )
    #: Public part of the token.
    id: Mapped[str] = mapped_column(primary_key=True)
    name: Mapped[str]
    role: Mapped[str]
    secret_hash: Mapped[str]
    created_at: Mapped[float]
    expires_at: Mapped[float]
    revoked_at: Mapped[float | None]
    #: To the minute.
    last_used_at: Mapped[float | None]


class SessionRow(Base):
    """A browser that is signed in; it ends with its token."""

    __tablename__ = "session"
    __table_args__ = (Index("session_of_token", "token_id"), _STRICT)
    id: Mapped[str] = mapped_column(primary_key=True)
    token_id: Mapped[str] = mapped_column(ForeignKey("token.id"))
    secret_hash: Mapped[str]
    created_at: Mapped[float]
    expires_at: Mapped[float]


class AuditRow(Base):
    """One request that changed something, or was refused to."""

    __tablename__ = "audit"
    __table_args__ = (_STRICT,)
    id: Mapped[int] = mapped_column(primary_key=True)
    created_at: Mapped[float]
    #: Name of the token, `loopback`, or `nobody`.
    actor: Mapped[str]
    token_id: Mapped[str | None] = mapped_column(ForeignKey("token.id"))
    address: Mapped[str]
    method: Mapped[str]
    path: Mapped[str]
    status: Mapped[int]
