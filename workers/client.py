"""HTTP client of the coordinator: every request is sent once; five of them are the source of jobs.

Whether and when to retry is for the caller; what may be retried is raised as `UnreachableError`.

    ApiError(WorkerError)    an invalid URL
        RejectedError        an answer that stays the same however often one asks
    UnreachableError         see `workers.messages`
"""

import ipaddress
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import TracebackType
from typing import Any, NoReturn, Self, TypeVar

import httpx
from pydantic import BaseModel, ValidationError

from core.errors import UserError
from workers.messages import (
    ClaimAnswer,
    ClaimRequest,
    CompleteAnswer,
    CompleteManyAnswer,
    FaultyError,
    Finished,
    HandedIn,
    HandInAnswer,
    HeartbeatAnswer,
    HeartbeatRequest,
    RefusedError,
    StaleAttemptError,
    UnacceptableError,
    UnreachableError,
    WorkerError,
)

#: Where the routes of the coordinator begin.
ROOT = "/api/v1"
#: How long an answer may take [s].
TIMEOUT_S = 15.0
#: Shorter than servers keep an idle connection, so that we never write into one that is being closed [s].
KEEPALIVE_S = 3.0
#: What a coordinator, or a proxy before it, answers while it cannot work.
PASSING = (408, 425, 429, 502, 503, 504)

#: What a coordinator may refuse for what is in it, and go on with the worker.
REPORTS = ("hand-in", "complete", "complete-many")

A = TypeVar("A", bound=BaseModel)


class ApiError(UserError, WorkerError):
    """A request that the coordinator cannot answer."""


class RejectedError(ApiError):
    """A request that was rejected, with the HTTP status and a machine-readable code."""

    def __init__(self, status: int, detail: str, code: str | None = None) -> None:
        super().__init__(detail)
        self.status = status
        self.code = code


class Api:
    """Connection to one coordinator; thread-safe."""

    def __init__(
        self,
        url: str,
        token: str | None = None,
        timeout_s: float = TIMEOUT_S,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        self.url = url.rstrip("/")
        self._http = httpx.Client(
            base_url=_check_url(self.url) + ROOT,
            headers={"Authorization": f"Bearer {token}"} if token else {},
            timeout=timeout_s,
            limits=httpx.Limits(keepalive_expiry=KEEPALIVE_S),
            # A proxy of the environment leads away from this machine.
            trust_env=not _is_loopback(self.url),
            transport=transport,
        )

    def use_token(self, token: str) -> None:
        """Authenticate with another token from now on."""
        self._http.headers["Authorization"] = f"Bearer {token}"

    def __enter__(self) -> Self:
        """Return itself; connections are closed at the end of the block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._http.close()

    def ask(
        self, verb: str, path: str, answer: type[A], body: BaseModel | str | None = None, **more: Any
    ) -> A:
        """Return the answer of a route, parsed; a text is JSON, and `more` is what httpx takes besides."""
        return self.ask_for_status(verb, path, answer, body, **more)[0]

    def ask_for_status(
        self, verb: str, path: str, answer: type[A], body: BaseModel | str | None = None, **more: Any
    ) -> tuple[A, int]:
        """Return the answer of a route, parsed, and its status."""
        if body is not None:
            content = body if isinstance(body, str) else body.model_dump_json()
            more |= {"content": content, "headers": {"Content-Type": "application/json"}}
        with self._faults_named():
            reply = self._http.request(verb, path, **more)
        if not reply.is_success:
            self._refuse(reply)
        if reply.headers.get("content-type", "").startswith("text/html"):
            raise RejectedError(
                reply.status_code, f"coordinator: expected one at {self.url}, got an answer of something else"
            )
        try:
            return answer.model_validate_json(reply.content), reply.status_code
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"]))
            raise RejectedError(
                reply.status_code,
                f"coordinator {self.url}: expected {answer.__name__} from {path}, got {first['msg']} at "
                f"{place!r}; install the coordinator's version here",
            ) from None

    @contextmanager
    def stream(self, path: str, headers: Mapping[str, str], read_timeout_s: float) -> Iterator[Iterator[str]]:
        """Yield the lines of a streamed response."""
        with self._open(path, headers, read_timeout_s) as reply:
            yield reply.iter_lines()

    def pieces(self, path: str, read_timeout_s: float) -> Iterator[bytes]:
        """Yield a large response in chunks; raise if it was cut short."""
        with self._open(path, {}, read_timeout_s) as reply:
            yield from reply.iter_bytes()

    @contextmanager
    def _open(self, path: str, headers: Mapping[str, str], read_timeout_s: float) -> Iterator[httpx.Response]:
        timeout = httpx.Timeout(TIMEOUT_S, read=read_timeout_s)
        with self._faults_named(), self._http.stream("GET", path, headers=headers, timeout=timeout) as reply:
            if not reply.is_success:
                reply.read()
                self._refuse(reply)
            yield reply

    @contextmanager
    def _faults_named(self) -> Iterator[None]:
        try:
            yield
        except httpx.TransportError as error:
            reason = str(error) or type(error).__name__
            raise UnreachableError(f"coordinator: expected one at {self.url}, got {reason}") from error

    def _refuse(self, reply: httpx.Response) -> NoReturn:
        detail, code = _fault_of(reply)
        if reply.status_code == 500:
            raise FaultyError(f"coordinator {self.url}: expected an answer, got 500, {detail}", status=500)
        if reply.status_code in PASSING:
            raise UnreachableError(
                f"coordinator {self.url}: expected an answer, got {reply.status_code}, {detail}",
                _seconds(reply.headers.get("Retry-After", "")),
                reply.status_code,
            )
        raise RejectedError(reply.status_code, detail, code)


class HttpSource:
    """A coordinator as a source of jobs; `ask_for_token` gets another token where one is refused."""

    def __init__(self, api: Api, ask_for_token: Callable[[], None] | None = None) -> None:
        self._api = api
        self._ask_for_token = ask_for_token

    def claim(self, request: ClaimRequest) -> ClaimAnswer:
        """Return jobs, which this worker then holds under a lease."""
        return self._ask("claim", request, ClaimAnswer)

    def heartbeat(self, request: HeartbeatRequest) -> HeartbeatAnswer:
        """Extend the leases of what is held; return what is to be cancelled, and what is lost."""
        return self._ask("heartbeat", request, HeartbeatAnswer)

    def hand_in(self, part: HandedIn) -> HandInAnswer:
        """Report hops of a chain that goes on."""
        return self._report("hand-in", part.to_json(), HandInAnswer)

    def complete(self, report: Finished) -> CompleteAnswer:
        """Report an outcome."""
        return self._report("complete", report.to_json(), CompleteAnswer)

    def complete_many(self, reports: Sequence[Finished]) -> CompleteManyAnswer:
        """Report several outcomes; none is taken if this raises."""
        texts = ",".join(report.to_json() for report in reports)
        return self._report("complete-many", f'{{"reports":[{texts}]}}', CompleteManyAnswer)

    def _report(self, verb: str, request: str, answer: type[A]) -> A:
        try:
            return self._ask(verb, request, answer)
        except RejectedError as error:
            raise UnacceptableError(str(error)) from error

    def _ask(self, verb: str, request: BaseModel | str, answer: type[A]) -> A:
        try:
            return self._api.ask("POST", f"/jobs/{verb}", answer, request)
        except RejectedError as error:
            if error.status == 401 and self._ask_for_token is not None:
                self._ask_for_token()
                raise UnreachableError(f"{error}; a new token is asked for") from error
            if error.code in ("stale_attempt", "other_claimant"):
                raise StaleAttemptError(str(error)) from error
            if verb in REPORTS and error.status in (404, 413, 422):
                raise
            raise RefusedError(str(error)) from error


def _fault_of(reply: httpx.Response) -> tuple[str, str | None]:
    """Return the detail and the code of an error response."""
    try:
        fault = reply.json()
        return str(fault["detail"]), fault.get("code")
    except (ValueError, KeyError, TypeError, AttributeError):
        url = reply.request.url
        return f"coordinator: expected one at {url}, got status {reply.status_code} of something else", None


def _check_url(url: str) -> str:
    try:
        parsed = httpx.URL(url)
    except httpx.InvalidURL as error:
        raise ApiError(f"url: expected one as http://host:8741, got {url}: {error}") from None
    if parsed.scheme not in ("http", "https") or not parsed.host:
        raise ApiError(f"url: expected one as http://host:8741, got {url}")
    return url


def _is_loopback(url: str) -> bool:
    host = httpx.URL(url).host
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _seconds(text: str) -> float:
    return float(text) if text.isdecimal() and len(text) < 6 else 0.0
