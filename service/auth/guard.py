"""Authentication, authorization, rate limiting and audit logging, before every route.

In order: refusals that hold for everybody (`service.auth.network`), the route (those that
`service.auth.rights` does not list are denied), the identity behind a token or a cookie, its role, its rate
limit and open streams, the body.  Requests of people take turns, so that workers find a thread and a
processor.  The answer to a request that changes something is in the audit before it is sent.  Limits live in
the memory of the web server and are used from its event loop alone.
"""

import asyncio
import logging
import math
import time
from collections import Counter, OrderedDict
from collections.abc import Callable
from urllib.parse import quote

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import cookie_parser
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.auth.network import (
    ANSWER_HEADERS,
    UNSAFE,
    Access,
    fault_of,
    is_own_origin,
    most_bytes,
    seen_from,
)
from service.auth.request_limits import read_body, replay_body
from service.auth.rights import (
    ANYONE,
    FLIGHTS,
    HEAVY,
    PROMPT,
    RIGHTS,
    STREAMS,
    UNLOGGED,
    UPLOADS,
    WORKERS,
    RouteIndex,
    least,
)
from service.db.errors import UnavailableError
from service.errors import (
    BodyError,
    failed,
    forbidden,
    problem_response,
    too_many,
    unauthorized,
    unavailable,
    unrouted,
)
from service.schemas.identity import Role
from service.store.identity import COOKIE, OWNER, Identity, RefusedTokenError
from service.store.store import Store

log = logging.getLogger(__name__)

#: Clients that are remembered; the one seen longest ago is forgotten first.
MAX_CLIENTS = 10_000
#: How long a request waits for its turn [s].
PATIENCE_S = 60.0


class Buckets:
    """Token buckets, one per client, of size `burst`, refilled at `rate_per_s`."""

    def __init__(self, rate_per_s: float, burst: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate = rate_per_s
        self._burst = burst
        self._clock = clock
        self._levels: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, client: str) -> int:
        """Take a token; return 0, or the seconds until there is one."""
        now = self._clock()
        level, seen = self._levels.pop(client, (float(self._burst), now))
        level = min(self._burst, level + (now - seen) * self._rate)
        is_granted = level >= 1.0
        self._levels[client] = (level - is_granted, now)
        if len(self._levels) > MAX_CLIENTS:
            self._levels.popitem(last=False)
        return 0 if is_granted else math.ceil((1.0 - level) / self._rate)


class Streams:
    """Open streams per client."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._open: Counter[str] = Counter()

    @property
    def n_open(self) -> int:
        """How many are open in all."""
        return self._open.total()

    def enter(self, client: str) -> bool:
        """Open a stream, unless the limit is reached."""
        if self._open[client] >= self._most:
            return False
        self._open[client] += 1
        return True

    def leave(self, client: str) -> None:
        """Close a stream."""
        self._open[client] -= 1
        if not self._open[client]:
            del self._open[client]


class Turns:
    """Limits concurrent requests; the others wait in order of arrival."""

    def __init__(self, at_once: int) -> None:
        self._turns = asyncio.Semaphore(at_once)

    async def enter(self) -> bool:
        """Wait for a turn; return whether it came in time."""
        try:
            await asyncio.wait_for(self._turns.acquire(), PATIENCE_S)
        except TimeoutError:
            return False
        return True

    def leave(self) -> None:
        """End a turn."""
        self._turns.release()


#: Anonymous requests that are audited: enough to see an attack, too few to fill a disk.
NOBODYS_AUDIT_PER_S, NOBODYS_AUDIT_BURST = 0.1, 100
#: Requests of people that run at once, so that most of the threads, of which there are forty, and of the
#: processor stay for workers.
READS, HEAVY_READS, FLOWN_READS, CHANGES = 2, 1, 1, 16


class Visit:
    """One request in the middleware."""

    def __init__(self, scope: Scope, access: Access) -> None:
        self.headers = Headers(scope=scope)
        self.fault = fault_of(scope, self.headers, access)
        self.address, scheme = seen_from(scope, self.headers, access)
        self.scope = {**scope, "scheme": scheme, "client": (self.address, 0)}
        self.scope["state"] = dict(scope.get("state", {}))
        self.method: str = scope["method"]
        self.path: str = scope["path"]
        #: Name of the route in `service.auth.rights`.
        self.line = ""

    @property
    def identity(self) -> Identity | None:
        """Who sends it; sign-in sets it as well."""
        identity: Identity | None = self.scope["state"].get("identity")
        return identity

    @identity.setter
    def identity(self, identity: Identity | None) -> None:
        self.scope["state"]["identity"] = identity

    @property
    def client(self) -> str:
        """Whose bucket it draws from."""
        return self.identity.token_id if self.identity and self.identity.token_id else self.address

    @property
    def is_unsafe(self) -> bool:
        """Whether it may change something."""
        return self.method in UNSAFE

    @property
    def is_page(self) -> bool:
        """Whether the response is a page for people."""
        return self.method == "GET" and "text/html" in self.headers.get("accept", "")

    @property
    def target(self) -> str:
        """Path and query."""
        query = self.scope.get("query_string", b"").decode("latin-1")
        return f"{self.path}?{query}" if query else self.path


class Guard:
    """The middleware: passes requests on to the application, or answers them itself."""

    def __init__(self, app: ASGIApp, *, store: Store, access: Access, streams: Streams) -> None:
        settings = access.settings
        self._app = app
        self._store = store
        self._access = access
        self._routes = RouteIndex()
        self._people = Buckets(settings.requests_per_second, settings.request_burst)
        self._workers = Buckets(settings.worker_requests_per_second, settings.worker_request_burst)
        self._nobody = Buckets(NOBODYS_AUDIT_PER_S, NOBODYS_AUDIT_BURST)
        self._streams = streams
        self._uploads = Streams(1)
        self._reads, self._heavy = Turns(READS), Turns(HEAVY_READS)
        self._flown, self._changes = Turns(FLOWN_READS), Turns(CHANGES)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Check, then pass on."""
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
            return
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        visit = Visit(scope, self._access)
        outward = _Outward(self, visit, send)
        answer = await self._refusal(visit)
        if answer is not None:
            await answer(visit.scope, receive, outward)
        elif visit.line in STREAMS:
            await self._while_open(self._streams, "streams", visit, receive, outward)
        elif visit.line in UPLOADS:
            await self._while_open(self._uploads, "uploads", visit, receive, outward)
        else:
            await self._pass_on(visit, receive, outward)

    async def _refusal(self, visit: Visit) -> Response | None:
        """Return the answer to a request that is refused by its head, or None."""
        if visit.fault is not None:
            return problem_response(*visit.fault)
        visit.line, verbs = self._routes.find(visit.scope)
        if not visit.line:
            return unrouted(visit.method, visit.path, verbs)
        roles = RIGHTS.get(visit.line, frozenset())
        reason = ""
        if roles is not ANYONE or visit.is_unsafe:
            try:
                visit.identity = await run_in_threadpool(self._identity, visit.headers)
            except RefusedTokenError as error:
                reason = str(error)
            except UnavailableError as error:
                # Whether the token is valid is unknown now.
                self._store.downtime.tell(error)
                return unavailable(error)
        if wait := self._wait(visit):
            return too_many("requests: expected fewer of them, got too many at once", wait)
        return None if roles is ANYONE else _by_role(visit, roles, reason)

    def _identity(self, headers: Headers) -> Identity | None:
        """Return who sends a request, None if it does not say; raise if what it says is wrong."""
        if (given := headers.get("authorization")) is not None:
            scheme, _, token = given.partition(" ")
            if scheme.lower() != "bearer":
                raise RefusedTokenError("Authorization: expected Bearer and a token, got another scheme")
            return self._store.identities.identify(token.strip())
        if self._access.is_open:
            return OWNER
        cookie = cookie_parser(headers.get("cookie", "")).get(COOKIE)
        return self._store.identities.identify_session(cookie) if cookie else None

    def _wait(self, visit: Visit) -> int:
        is_worker = visit.identity is not None and visit.identity.role is Role.WORKER
        return (self._workers if is_worker else self._people).take(visit.client)

    async def _while_open(
        self, counted: Streams, what: str, visit: Visit, receive: Receive, send: "_Outward"
    ) -> None:
        if not counted.enter(visit.client):
            answer = too_many(f"{what}: expected fewer open ones, got as many as are allowed", 10)
            await answer(visit.scope, receive, send)
            return
        try:
            await self._pass_on(visit, receive, send)
        finally:
            counted.leave(visit.client)

    async def _pass_on(self, visit: Visit, receive: Receive, send: "_Outward") -> None:
        if visit.is_unsafe and visit.line not in UPLOADS:
            try:
                body = await read_body(receive, visit.headers.get("content-type", ""), most_bytes(visit.path))
            except BodyError as fault:
                await problem_response(fault.status, str(fault))(visit.scope, receive, send)
                return
            receive = replay_body(body, receive)
        turns = self._turns_of(visit)
        if turns is None:
            await self._answer(visit, receive, send)
            return
        if not await turns.enter():
            busy = too_many("requests: expected a turn in time, got too many before this one", 10)
            await busy(visit.scope, receive, send)
            return
        send.turns = turns
        try:
            await self._answer(visit, receive, send)
        finally:
            send.end_turn()

    def _turns_of(self, visit: Visit) -> Turns | None:
        """Return whose turn a request waits for; workers and probes wait for nobody's."""
        if visit.line in STREAMS | UPLOADS | PROMPT or RIGHTS.get(visit.line) == WORKERS:
            return None
        if visit.is_unsafe:
            return self._changes
        if visit.line in FLIGHTS:
            return self._flown
        return self._heavy if visit.line in HEAVY else self._reads

    async def _answer(self, visit: Visit, receive: Receive, send: "_Outward") -> None:
        try:
            await self._app(visit.scope, receive, send)
        except Exception:
            if not send.has_begun:
                # Answered here, so that this answer has its headers and its audit row too.
                await failed()(visit.scope, receive, send)
            raise

    def audit(self, visit: Visit, status: int) -> None:
        """Record the response to a changing request in the audit log."""
        who = visit.identity
        if who is not None and visit.line in UNLOGGED and (status < 400 or status == 409):
            return
        if who is None and self._nobody.take(""):
            return
        try:
            self._store.identities.record(who, visit.address, visit.method, visit.path[:500], status)
        except UnavailableError as error:
            # The answer stands whether or not it could be written down.
            self._store.downtime.tell(error)
        except Exception:
            log.exception("audit: %s %s -> %d not written", visit.method, visit.line, status)


class _Outward:
    """Sends a response with the common headers, once it is in the audit log."""

    def __init__(self, guard: Guard, visit: Visit, send: Send) -> None:
        self.has_begun = False
        #: In which the request has a turn.
        self.turns: Turns | None = None
        self._guard = guard
        self._visit = visit
        self._send = send

    async def __call__(self, message: Message) -> None:
        """Send a message."""
        if message["type"] == "http.response.start":
            self.has_begun = True
            headers = MutableHeaders(scope=message)
            for name, value in ANSWER_HEADERS.items():
                headers.setdefault(name, value)
            if self._visit.is_unsafe:
                await run_in_threadpool(self._guard.audit, self._visit, message["status"])
            # The response is complete: a slow reader must not hold a turn.
            self.end_turn()
        await self._send(message)

    def end_turn(self) -> None:
        """End the turn of the request, if it has one."""
        if self.turns is not None:
            self.turns.leave()
            self.turns = None


def _by_role(visit: Visit, roles: frozenset[Role], reason: str) -> Response | None:
    """Return the refusal of somebody without the role that a route asks for, or None."""
    if visit.identity is None:
        if visit.is_page:
            return RedirectResponse(f"/sign-in?next={quote(visit.target, safe='')}", status_code=303)
        return unauthorized(reason or "Authorization: expected Bearer and a token, got none")
    if not roles:
        return problem_response(403, f"{visit.line}: expected a line in the table of rights, got none")
    if visit.identity.role not in roles:
        return forbidden(f"{visit.line}: expected role {least(roles)}, got {visit.identity.role.value}")
    if visit.is_unsafe and visit.identity.is_cookie and not is_own_origin(visit.headers):
        return problem_response(403, "Origin: expected that of this service with a cookie, got none")
    return None
