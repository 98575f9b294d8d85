"""Error responses as `application/problem+json` (RFC 9457).

BodyError(ValueError)     a body that a route cannot read
BusyError(RuntimeError)   as many heavy requests as there is room for
"""

import logging
from collections.abc import Callable, Collection, Mapping
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from core.errors import fault_lines
from core.export import ExportError
from core.problem import ProblemError
from service.archive_format.container import PortableConflictError, PortableError
from service.db.errors import UnavailableError, WriteError
from service.schemas.answer import Fault
from service.spec import SpecError
from service.store.errors import ConflictError, OtherClaimantError, StoreError, UnknownRowError
from service.store.identity import RefusedTokenError
from workers.messages import StaleAttemptError

log = logging.getLogger(__name__)

#: After which time a client should ask again for what is busy [s].
BUSY_PAUSE_S = 10


class BusyError(RuntimeError):
    """As many heavy requests as there is room for."""


class BodyError(ValueError):
    """A body that no route will see; carries the status of the refusal."""

    def __init__(self, status: int, detail: str) -> None:
        super().__init__(detail)
        self.status = status


#: What every route may answer besides its own; goes into the OpenAPI document.
REFUSALS: dict[int | str, dict[str, Any]] = {
    status: {"model": Fault, "content": {"application/problem+json": {}}}
    for status in (401, 403, 404, 413, 422, 429, 503)
}
#: After which an archive that could not be used is worth trying again [s].
ARCHIVE_PAUSE_S = 5

UNROUTED = {
    404: "path: expected one of this service, got {path}; the list is at /api/v1/openapi.json",
    405: "method: expected one that {path} has, got {method}",
}

#: What a refusal asks for (RFC 6750).
CHALLENGE = 'Bearer realm="coastarc"'
NO_JSON = "body: expected JSON in UTF-8, got"


def problem_response(
    status: int, detail: str, headers: Mapping[str, str] | None = None, code: str | None = None
) -> JSONResponse:
    """Return a refusal; `code` is for programs that must tell refusals of one status apart."""
    fault = Fault(title=HTTPStatus(status).phrase, status=status, detail=detail, code=code)
    return JSONResponse(
        fault.model_dump(exclude_none=True),
        status_code=status,
        media_type="application/problem+json",
        headers=dict(headers or {}),
    )


def unauthorized(detail: str) -> JSONResponse:
    """Return the refusal of somebody whom we do not know."""
    return problem_response(401, detail, {"WWW-Authenticate": CHALLENGE})


def forbidden(detail: str) -> JSONResponse:
    """Return the refusal of somebody whose role may not."""
    return problem_response(403, detail, {"WWW-Authenticate": f'{CHALLENGE}, error="insufficient_scope"'})


def too_many(detail: str, seconds: int) -> JSONResponse:
    """Return the refusal of somebody who asks too often."""
    return problem_response(429, f"{detail}; wait {seconds} s", {"Retry-After": str(seconds)})


def unavailable(error: UnavailableError) -> JSONResponse:
    """Return the refusal of an archive that cannot be used now; where it is is for the log alone."""
    expected = "take a write" if isinstance(error, WriteError) else "answer"
    detail = f"archive: expected to {expected}, got a fault; what was stored before is kept"
    return problem_response(503, detail, {"Retry-After": str(ARCHIVE_PAUSE_S)}, code="archive_unavailable")


def unrouted(method: str, path: str, verbs: Collection[str]) -> JSONResponse:
    """Return the refusal of a path that leads nowhere, or of a verb that it does not have."""
    if not verbs:
        return problem_response(404, UNROUTED[404].format(path=path[:200]))
    allow = {"Allow": ", ".join(sorted(verbs))}
    return problem_response(405, UNROUTED[405].format(path=path[:200], method=method[:20]), allow)


def failed() -> JSONResponse:
    """Return the answer where we failed; what went wrong inside is for the log, not for the client."""
    # The web server closes the connection now, and who does not know sends the next request into its end.
    return problem_response(500, "the service failed; its log has the details", {"Connection": "close"})


def _http(request: Request, error: HTTPException) -> JSONResponse:
    if error.status_code == 400:
        # The framework's word for bytes that are no text, and for lists a thousand deep.
        return problem_response(422, f"{NO_JSON} what cannot be read")
    detail = str(error.detail)
    if detail == HTTPStatus(error.status_code).phrase:
        # What the framework refuses by itself says no more than the status.
        detail = UNROUTED.get(error.status_code, "request: expected another, got {method} {path}")
        detail = detail.format(method=request.method, path=request.url.path)
    return problem_response(error.status_code, detail, error.headers)


def _invalid_request(_: Request, error: RequestValidationError) -> JSONResponse:
    for fault in error.errors():
        if fault["type"] == "json_invalid":
            reason, place = fault["ctx"]["error"], fault["loc"][-1]
            return problem_response(422, f"{NO_JSON} {reason} at character {place}")
    return problem_response(422, "\n".join(fault_lines("request", error.errors())))


def _unprocessable(_: Request, error: Exception) -> JSONResponse:
    return problem_response(422, str(error))


def _portable_conflict(_: Request, error: PortableConflictError) -> JSONResponse:
    return problem_response(409, str(error), code="wrong_state")


def _unreadable_body(_: Request, error: BodyError) -> JSONResponse:
    return problem_response(error.status, str(error))


def _busy(_: Request, error: BusyError) -> JSONResponse:
    return problem_response(503, str(error), {"Retry-After": str(BUSY_PAUSE_S)})


def _stale_attempt(_: Request, error: StaleAttemptError) -> JSONResponse:
    return problem_response(409, str(error), code="stale_attempt")


def _unavailable_archive(request: Request, error: UnavailableError) -> JSONResponse:
    request.app.state.store.downtime.tell(error)
    return unavailable(error)


def _unexpected(_: Request, error: Exception) -> JSONResponse:
    return failed()


def _refused_token(_: Request, error: RefusedTokenError) -> JSONResponse:
    return unauthorized(str(error))


def _unknown_row(_: Request, error: UnknownRowError) -> JSONResponse:
    return problem_response(404, str(error))


def _conflict(_: Request, error: ConflictError) -> JSONResponse:
    return problem_response(409, str(error), code=error.code)


def _other_claimant(_: Request, error: OtherClaimantError) -> JSONResponse:
    return problem_response(403, str(error), code="other_claimant")


#: What answers each exception; the framework takes the line of the nearest class.
HANDLERS: dict[type[Exception], Callable[[Request, Any], JSONResponse]] = {
    HTTPException: _http,
    RequestValidationError: _invalid_request,
    SpecError: _unprocessable,
    ExportError: _unprocessable,
    ProblemError: _unprocessable,
    PortableError: _unprocessable,
    PortableConflictError: _portable_conflict,
    BodyError: _unreadable_body,
    BusyError: _busy,
    StaleAttemptError: _stale_attempt,
    UnavailableError: _unavailable_archive,
    RefusedTokenError: _refused_token,
    UnknownRowError: _unknown_row,
    ConflictError: _conflict,
    OtherClaimantError: _other_claimant,
    StoreError: _unprocessable,
    Exception: _unexpected,
}


def add_error_handlers(app: FastAPI) -> None:
    """Turn what the layers below raise into refusals."""
    for error, handler in HANDLERS.items():
        app.add_exception_handler(error, handler)
