"""Tokens, sessions and the audit: who may use the archive, and who did what.

A token is `coastarc_<id>_<secret>`.  The id finds its row and may be shown; the secret is 32 random bytes,
of which only a hash is ever stored: at 256 bits nobody guesses, so the hash need not be slow.

RefusedTokenError(StoreError)   a token or session that is not in force, or none at all
TakenNameError(Conflict)        a token of this name is in use
"""

import hashlib
import hmac
import logging
import re
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import ColumnElement, delete, select, update
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from service.db.engine import Database
from service.db.errors import DatabaseError
from service.db.tables import AuditRow, SessionRow, TokenRow
from service.schemas.identity import AuditPage, AuditView, NewToken, Role, TokenView
from service.store.errors import ConflictError, StoreError, UnknownRowError

log = logging.getLogger(__name__)

#: Name of the cookie that holds a session.
COOKIE = "coastarc_session"
_WRITTEN = re.compile(r"coastarc_([0-9a-f]{12})_([A-Za-z0-9_-]{43})")


@dataclass(frozen=True, slots=True)
class Identity:
    """Who a request comes from."""

    #: Name of the token, or `loopback` where no token is asked for.
    name: str
    role: Role
    token_id: str | None = None
    #: A browser sends its cookie unasked, so what it sends is looked at twice.
    is_cookie: bool = False


#: The user of this machine, where no sign-in is required.
OWNER = Identity("loopback", Role.ADMIN)


@dataclass(frozen=True, slots=True, repr=False)
class Secret:
    """A new token or session, in the only moment in which its secret is known."""

    id: str
    secret: str

    def written(self) -> str:
        """Return the text to hand over."""
        return f"coastarc_{self.id}_{self.secret}"


def new_secret() -> Secret:
    """Return a token nobody has seen."""
    return Secret(secrets.token_hex(6), secrets.token_urlsafe(32))


def split_token(text: str) -> Secret | None:
    """Return the parts of a written token, or None if it is none."""
    found = _WRITTEN.fullmatch(text)
    return Secret(*found.groups()) if found else None


def hash_secret(secret: str) -> str:
    """Return what is stored of a secret."""
    return hashlib.blake2b(secret.encode(), digest_size=32, person=b"coastarc token").hexdigest()


def is_secret_of(secret: str, stored: str) -> bool:
    """Return whether a secret belongs to a stored hash, in a time that tells nothing about either."""
    return hmac.compare_digest(hash_secret(secret), stored)


DAY_S = 86400.0
#: How long a browser stays signed in, if its token lives that long [s].
SESSION_S = 12 * 3600.0
#: The use of a token is written down this often at most [s].
USE_PERIOD_S = 60.0
#: Compared with where no row is found, so that such an answer takes as long as any other.
_NO_HASH = hash_secret("")


class RefusedTokenError(StoreError):
    """A token or session that is not in force, or none at all."""


class TakenNameError(ConflictError):
    """A token of this name is in use."""

    code = "name_taken"


class Identities:
    """Who may use an archive."""

    def __init__(self, database: Database, clock: Callable[[], float]) -> None:
        self._database = database
        self._clock = clock

    def has_token(self) -> bool:
        """Return whether somebody, and not only a worker, could sign in."""
        in_force = (TokenRow.revoked_at.is_(None)) & (TokenRow.expires_at > self._clock())
        with self._database.read() as session:
            query = select(TokenRow.id).where(in_force, TokenRow.role != Role.WORKER.value).limit(1)
            return session.scalar(query) is not None

    def create(self, name: str, role: Role, days: float) -> NewToken:
        """Make a token; this answer is the only one that shows it."""
        return self._database.write(lambda session: _create(session, name, role, days, self._clock()))

    def replace(self, name: str, role: Role, days: float) -> NewToken:
        """Make a token in place of the one that has this name."""

        def work(session: Session) -> NewToken:
            now = self._clock()
            session.execute(_revocation(now).where(TokenRow.name == name))
            # A program that is restarted for months must not leave a row each time.
            _forget(session, TokenRow.name == name)
            return _create(session, name, role, days, now)

        return self._database.write(work)

    def tokens(self) -> list[TokenView]:
        """Return all tokens, the newest first."""
        with self._database.read() as session:
            rows = session.scalars(select(TokenRow).order_by(TokenRow.created_at.desc(), TokenRow.id))
            return [_view(row, self._clock()) for row in rows]

    def revoke(self, name_or_id: str) -> TokenView:
        """End a token and its sessions at once."""
        return self._database.write(lambda session: _revoke(session, name_or_id, self._clock()))

    def identify(self, written: str) -> Identity:
        """Return whose token this is, or raise."""
        with self._database.read() as session:
            row = _token(session, written, self._clock())
        self._note_use(row)
        return Identity(row.name, Role(row.role), row.id)

    def identify_session(self, written: str) -> Identity:
        """Return whose session this is, or raise."""
        with self._database.read() as session:
            row = _session_token(session, written, self._clock())
        self._note_use(row)
        return Identity(row.name, Role(row.role), row.id, is_cookie=True)

    def sign_in(self, written: str) -> tuple[str, float, Identity]:
        """Trade a token for a session: what the cookie holds, how long it lives [s], and whose it is."""
        return self._database.write(lambda session: _sign_in(session, written, self._clock()))

    def sign_out(self, written: str) -> None:
        """End a session; idempotent."""
        parts = split_token(written)
        if parts is not None:
            mine = (SessionRow.id == parts.id) & (SessionRow.secret_hash == hash_secret(parts.secret))
            self._database.write(lambda session: session.execute(delete(SessionRow).where(mine)))

    def record(self, identity: Identity | None, address: str, method: str, path: str, status: int) -> None:
        """Write down a request that changed something, or was refused to."""
        row = AuditRow(
            created_at=self._clock(),
            actor=identity.name if identity else "nobody",
            token_id=identity.token_id if identity else None,
            address=address,
            method=method,
            path=path,
            status=status,
        )
        self._database.write(lambda session: session.add(row))

    def audit(self, limit: int, before: int | None = None) -> AuditPage:
        """Return a page of the audit, the newest first."""
        query = select(AuditRow).order_by(AuditRow.id.desc()).limit(limit + 1)
        if before is not None:
            query = query.where(AuditRow.id < before)
        with self._database.read() as session:
            rows = [_audit_view(row) for row in session.scalars(query)]
        return AuditPage(items=rows[:limit], next=rows[limit - 1].id if len(rows) > limit else None)

    def _note_use(self, row: TokenRow) -> None:
        now = self._clock()
        if row.last_used_at is None or now - row.last_used_at > USE_PERIOD_S:
            used = update(TokenRow).where(TokenRow.id == row.id).values(last_used_at=now)
            try:
                self._database.write(lambda session: session.execute(used))
            except (SQLAlchemyError, DatabaseError) as error:
                # Reading goes on while the disk is full.
                log.warning("use of token %s not written: %s", row.id, error.__class__.__name__)


def _create(session: Session, name: str, role: Role, days: float, now: float) -> NewToken:
    taken = select(TokenRow.id).where(TokenRow.name == name, TokenRow.revoked_at.is_(None))
    if session.scalar(taken) is not None:
        raise TakenNameError(f"token: expected a name that is not in use, got {name}; revoke that one first")
    made = new_secret()
    row = TokenRow(
        id=made.id,
        name=name,
        role=role.value,
        secret_hash=hash_secret(made.secret),
        created_at=now,
        expires_at=now + days * DAY_S,
    )
    session.add(row)
    session.flush()
    return NewToken(**_view(row, now).model_dump(), token=made.written())


def _revoke(session: Session, name_or_id: str, now: float) -> TokenView:
    in_use = select(TokenRow).where(TokenRow.revoked_at.is_(None))
    row = session.scalar(in_use.where(TokenRow.name == name_or_id))
    row = row or session.scalar(in_use.where(TokenRow.id == name_or_id))
    if row is None:
        raise UnknownRowError("token", name_or_id, "none with this name or id")
    row.revoked_at = now
    session.execute(delete(SessionRow).where(SessionRow.token_id == row.id))
    return _view(row, now)


def _revocation(now: float) -> Any:
    return update(TokenRow).where(TokenRow.revoked_at.is_(None)).values(revoked_at=now)


def _forget(session: Session, which: ColumnElement[bool]) -> None:
    """Delete revoked tokens that the audit does not name."""
    named = select(AuditRow.id).where(AuditRow.token_id == TokenRow.id).exists()
    ended = list(session.scalars(select(TokenRow.id).where(which, TokenRow.revoked_at.is_not(None), ~named)))
    session.execute(delete(SessionRow).where(SessionRow.token_id.in_(ended)))
    session.execute(delete(TokenRow).where(TokenRow.id.in_(ended)))


def _token(session: Session, written: str, now: float) -> TokenRow:
    """Return the token in force that a text is."""
    parts = split_token(written)
    row = session.get(TokenRow, parts.id) if parts else None
    # The secret is compared first: only who has it is told more about the token.
    if not _is_right(parts, row) or row is None:
        raise RefusedTokenError("token: expected one that this service gave out, got another")
    return _in_force(row, now)


def _session_token(session: Session, written: str, now: float) -> TokenRow:
    parts = split_token(written)
    row = session.get(SessionRow, parts.id) if parts else None
    if not _is_right(parts, row) or row is None or row.expires_at <= now:
        raise RefusedTokenError("session: expected one that is open, got another; sign in again")
    token = session.get(TokenRow, row.token_id)
    assert token is not None  # a foreign key
    return _in_force(token, now)


def _is_right(parts: Secret | None, row: TokenRow | SessionRow | None) -> bool:
    return is_secret_of(parts.secret if parts else "-", row.secret_hash if row else _NO_HASH)


def _in_force(row: TokenRow, now: float) -> TokenRow:
    if (state := _state(row, now)) != "active":
        raise RefusedTokenError(f"token {row.name}: expected one in force, got one that is {state}")
    return row


def _sign_in(session: Session, written: str, now: float) -> tuple[str, float, Identity]:
    token = _token(session, written, now)
    session.execute(delete(SessionRow).where(SessionRow.expires_at <= now))
    made, lifetime = new_secret(), min(SESSION_S, token.expires_at - now)
    session.add(
        SessionRow(
            id=made.id,
            token_id=token.id,
            secret_hash=hash_secret(made.secret),
            created_at=now,
            expires_at=now + lifetime,
        )
    )
    return made.written(), lifetime, Identity(token.name, Role(token.role), token.id, is_cookie=True)


def _state(row: TokenRow, now: float) -> str:
    if row.revoked_at is not None:
        return "revoked"
    return "expired" if row.expires_at <= now else "active"


def _view(row: TokenRow, now: float) -> TokenView:
    return TokenView(
        id=row.id,
        name=row.name,
        role=Role(row.role),
        state=_state(row, now),
        created_at=_utc(row.created_at),
        expires_at=_utc(row.expires_at),
        revoked_at=None if row.revoked_at is None else _utc(row.revoked_at),
        last_used_at=None if row.last_used_at is None else _utc(row.last_used_at),
    )


def _audit_view(row: AuditRow) -> AuditView:
    columns = {name: getattr(row, name) for name in AuditView.model_fields if name != "created_at"}
    return AuditView(**columns, created_at=_utc(row.created_at))


def _utc(seconds: float) -> datetime:
    return datetime.fromtimestamp(seconds, UTC)
