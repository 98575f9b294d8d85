"""Tokens as text: made, taken apart, hashed.  No table and no request is known here.

A token is `coastarc_<id>_<secret>`.  The id finds its row and may be shown; the secret is 32 random bytes,
of which only a hash is ever stored: at 256 bits nobody guesses, so the hash need not be slow.
"""

import hashlib
import hmac
import re
import secrets
from dataclasses import dataclass

from service.schemas.identity import Role

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


#: Whoever sits at this machine, where no sign-in is required.
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


def taken_apart(text: str) -> Secret | None:
    """Return the parts of a written token, or None if it is none."""
    found = _WRITTEN.fullmatch(text)
    return Secret(*found.groups()) if found else None


def hashed(secret: str) -> str:
    """Return what is stored of a secret."""
    return hashlib.blake2b(secret.encode(), digest_size=32, person=b"coastarc token").hexdigest()


def is_secret_of(secret: str, stored: str) -> bool:
    """Return whether a secret belongs to a stored hash, in a time that tells nothing about either."""
    return hmac.compare_digest(hashed(secret), stored)
