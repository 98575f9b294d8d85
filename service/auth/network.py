"""Network access: addresses, host names, proxies, origins, and the headers of every response.

On loopback and on one machine a request needs no token and acts as the owner.  Then the checks here are
what stands between the service and a web page that the owner happens to visit: a Host that is ours stops
DNS rebinding, an Origin that is ours stops foreign forms.  Everywhere else tokens are asked for as well,
see `service.auth.guard`.
"""

import ipaddress
from collections.abc import Callable
from dataclasses import dataclass, field

from starlette.datastructures import Headers
from starlette.types import Scope

from core.errors import UserError
from service.settings import Settings

LOOPBACK_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})
FORWARDED = ("forwarded", "x-forwarded-for", "x-forwarded-host", "x-forwarded-proto", "x-real-ip")
UNSAFE = ("POST", "PUT", "PATCH", "DELETE")
#: plotly injects styles and draws into data: and blob: images.
POLICY = (
    "default-src 'self'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "object-src 'none'; base-uri 'none'; frame-ancestors 'none'; form-action 'self'"
)
ANSWER_HEADERS = {
    "content-security-policy": POLICY,
    "x-frame-options": "DENY",
    "x-content-type-options": "nosniff",
    # Not `no-referrer`: under that a browser hides the Origin of our own forms as well.
    "referrer-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}
#: Largest body of a request [byte]; a specification with hundreds of searches is a tenth of it.
MAX_BODY_BYTES = 512 * 1024
#: The same for the report of a worker: a chain of thousands of hops brings a vector for each.
MAX_REPORT_BYTES = 64 * 1024 * 1024
REPORT_PATHS = ("/api/v1/jobs/hand-in", "/api/v1/jobs/complete", "/api/v1/jobs/complete-many")
#: The same for the portable file of a campaign, which is never in memory as a whole.
MAX_PORTABLE_BYTES = 1024 * 1024 * 1024
PORTABLE_PATH = "/api/v1/campaigns/import"
#: Longest path and query together [byte].
MAX_TARGET_BYTES = 8 * 1024

Fault = tuple[int, str]


class BindError(UserError, ValueError):
    """A listening address that would expose the service without a token."""


@dataclass(frozen=True, slots=True)
class Access:
    """The access policy that `service.auth.guard` enforces."""

    #: Requests without a token act as the owner.
    is_open: bool = True
    #: Names and addresses under which we are reached, besides those of loopback.
    hosts: frozenset[str] = frozenset()
    settings: Settings = field(default_factory=Settings)

    def is_proxy(self, address: str) -> bool:
        """Return whether the forwarded headers of an address are believed."""
        parsed = _address(address)
        return parsed is not None and any(parsed in network for network in self.settings.proxies)


def access_on(host: str, settings: Settings, has_token: Callable[[], bool]) -> Access:
    """Return the access policy for a listening address; raise where it would be exposed without a token."""
    is_open = is_loopback(host) and settings.auth == "auto" and not settings.proxies
    if not is_open and not has_token():
        reason = "with sign-in required" if is_loopback(host) else "an address that others reach"
        raise BindError(
            f"host {host}, {reason}: expected a token, got none; "
            "create one with `coastarc token create NAME --role admin`, or serve on 127.0.0.1"
        )
    # An address that stands for all of them is nobody's name.
    own = () if host in ("0.0.0.0", "::") else (host.lower(),)
    return Access(is_open, frozenset((*own, *map(str.lower, settings.hosts))) - {""}, settings)


def is_loopback(host: str) -> bool:
    """Return whether an address is reachable from this machine alone."""
    address = _address(host)
    return host == "localhost" or (address is not None and address.is_loopback)


def fault_of(scope: Scope, headers: Headers, access: Access) -> Fault | None:
    """Return the status and the reason with which a request is refused whoever sends it, or None."""
    host, origin, length = headers.get("host", ""), headers.get("origin"), headers.get("content-length", "0")
    peer = scope["client"][0] if scope.get("client") else ""
    if access.is_open and _is_elsewhere(peer):
        return 403, f"client: expected one on this machine, got {peer}"
    if not _is_ours(_name_of(host), scope, access):
        return 403, f"Host: expected a name of this machine or one in COASTARC_HOSTS, got {host[:80]!r}"
    for name in FORWARDED:
        if name in headers and not access.is_proxy(peer):
            return 403, f"{name}: expected no proxy but those in COASTARC_PROXIES, got one at {peer}"
    if scope["method"] in UNSAFE and origin is not None and not is_own_origin(headers):
        return 403, f"Origin: expected that of {host}, got {origin[:80]!r}"
    if length.isdecimal() and int(length[:20]) > (most := most_bytes(scope["path"])):
        return 413, f"body: expected at most {most} bytes, got {length[:20]}"
    n_target = len(scope.get("raw_path") or b"") + len(scope.get("query_string") or b"")
    if n_target > MAX_TARGET_BYTES:
        return 414, f"address: expected at most {MAX_TARGET_BYTES} bytes, got {n_target}"
    return None


def most_bytes(path: str) -> int:
    """Return how large a body may be; it is read only after its sender's role is known."""
    if path == PORTABLE_PATH:
        return MAX_PORTABLE_BYTES
    return MAX_REPORT_BYTES if path in REPORT_PATHS else MAX_BODY_BYTES


def is_own_origin(headers: Headers) -> bool:
    """Return whether a request says that it comes from one of our own pages."""
    scheme, _, authority = headers.get("origin", "").partition("://")
    return scheme in ("http", "https") and authority == headers.get("host", "")


def seen_from(scope: Scope, headers: Headers, access: Access) -> tuple[str, str]:
    """Return the client's address and the scheme it uses, as a believed proxy reports them."""
    peer, scheme = scope["client"][0] if scope.get("client") else "", scope["scheme"]
    if access.is_proxy(peer):
        # From the right: what stands further left may be made up by the client.
        hops = [hop.strip() for hop in headers.get("x-forwarded-for", "").split(",") if hop.strip()]
        peer = next((hop for hop in reversed(hops) if not access.is_proxy(hop)), peer)[:64]
        scheme = "https" if headers.get("x-forwarded-proto", "").strip() == "https" else scheme
    return peer, scheme


def _is_ours(name: str, scope: Scope, access: Access) -> bool:
    if name in LOOPBACK_NAMES or name in access.hosts:
        return True
    # The address that a connection came in by is ours.  A rebound name is a name, never that address.
    server = scope.get("server")
    return not access.is_open and server is not None and name == server[0]


def _is_elsewhere(peer: str) -> bool:
    # A peer without an address is a socket file, or a test.
    address = _address(peer)
    return address is not None and not address.is_loopback


def _address(text: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(text)
    except ValueError:
        return None


def _name_of(authority: str) -> str:
    """Return the host of `host:port`, where an IPv6 host stands in brackets."""
    if authority.startswith("["):
        return authority[1:].partition("]")[0]
    return authority.partition(":")[0].lower()
