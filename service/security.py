"""Who may talk to the service: this machine alone, under its own name, from its own pages.

Without tokens every request acts as the owner, so the guards here are what stands between the service and
a web page that the owner happens to visit: a Host that is ours stops DNS rebinding, an Origin that is
ours stops foreign forms.
"""

import ipaddress

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.errors import problem_response

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "::1")
FORWARDED = ("forwarded", "x-forwarded-for", "x-forwarded-host", "x-forwarded-proto", "x-real-ip")
UNSAFE = ("POST", "PUT", "PATCH", "DELETE")
#: plotly injects styles and draws into data: and blob: images.
POLICY = (
    "default-src 'self'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "object-src 'none'; base-uri 'none'; frame-ancestors 'none'; form-action 'self'"
)
#: Largest body of a request; a specification with hundreds of searches is a tenth of it.
MAX_BODY_BYTES = 512 * 1024
ANSWER_HEADERS = {
    "content-security-policy": POLICY,
    "x-frame-options": "DENY",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
}


class BindError(ValueError):
    """An address on which the service would be open to others."""


def require_loopback(host: str) -> str:
    """Return the address to bind if it is reachable from this machine alone."""
    try:
        is_loopback = host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        is_loopback = False
    if not is_loopback:
        raise BindError(
            f"host: expected a loopback address such as 127.0.0.1, got {host}; this version has no sign-in, "
            f"so to reach it from elsewhere forward a port over ssh"
        )
    return host


class Guard:
    """Refuses requests that do not come from this machine's own pages and tools."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Check, then pass on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in ANSWER_HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        n_received = 0

        async def receive_limited() -> Message:
            nonlocal n_received
            message = await receive()
            n_received += len(message.get("body", b""))
            if n_received > MAX_BODY_BYTES:
                raise HTTPException(413, f"body: expected at most {MAX_BODY_BYTES} bytes, got more")
            return message

        fault = _fault(scope["method"], Headers(scope=scope))
        app = problem_response(*fault) if fault else self._app
        await app(scope, receive_limited, send_guarded)


def _fault(method: str, headers: Headers) -> tuple[int, str] | None:
    """Return the status and the reason with which a request is refused, or None."""
    host, origin, length = headers.get("host", ""), headers.get("origin"), headers.get("content-length", "0")
    if _name_of(host) not in LOOPBACK_NAMES:
        return 403, f"Host: expected a name of this machine, got {host!r}"
    for name in FORWARDED:
        if name in headers:
            return 403, f"{name}: expected no proxy before a service without sign-in, got {headers[name]!r}"
    if method in UNSAFE and origin is not None and origin.partition("://")[2] != host:
        return 403, f"Origin: expected http://{host}, got {origin!r}"
    if length.isdecimal() and int(length) > MAX_BODY_BYTES:
        return 413, f"body: expected at most {MAX_BODY_BYTES} bytes, got {length}"
    return None


def _name_of(authority: str) -> str:
    """Return the host of `host:port`, where an IPv6 host stands in brackets."""
    if authority.startswith("["):
        return authority[1:].partition("]")[0]
    return authority.partition(":")[0].lower()
