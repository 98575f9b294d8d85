"""Every refusal as `application/problem+json` (RFC 9457)."""

from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from core.faults import fault_lines
from service.api.schemas import Fault
from service.spec import SpecError
from service.store import StoreError, UnknownRow

#: What every route may answer besides its own; goes into the OpenAPI document.
REFUSALS: dict[int | str, dict[str, Any]] = {
    status: {"model": Fault, "content": {"application/problem+json": {}}} for status in (403, 404, 422)
}

UNROUTED = {
    404: "path: expected one of this service, got {path}; the list is at /api/v1/openapi.json",
    405: "method: expected one that {path} has, got {method}",
}


def problem_response(status: int, detail: str) -> JSONResponse:
    """Return a refusal."""
    fault = Fault(title=HTTPStatus(status).phrase, status=status, detail=detail)
    return JSONResponse(fault.model_dump(), status_code=status, media_type="application/problem+json")


def add_error_handlers(app: FastAPI) -> None:
    """Turn what the layers below raise into refusals."""

    @app.exception_handler(HTTPException)
    def http(request: Request, error: HTTPException) -> JSONResponse:
        detail = str(error.detail)
        if detail == HTTPStatus(error.status_code).phrase:
            # What the framework refuses by itself says no more than the status.
            detail = UNROUTED.get(error.status_code, "request: expected another, got {method} {path}")
            detail = detail.format(method=request.method, path=request.url.path)
        return problem_response(error.status_code, detail)

    @app.exception_handler(RequestValidationError)
    def request(_: Request, error: RequestValidationError) -> JSONResponse:
        return problem_response(422, "\n".join(fault_lines("request", error.errors())))

    @app.exception_handler(SpecError)
    def spec(_: Request, error: SpecError) -> JSONResponse:
        return problem_response(422, str(error))

    @app.exception_handler(UnknownRow)
    def unknown(_: Request, error: UnknownRow) -> JSONResponse:
        return problem_response(404, str(error))

    @app.exception_handler(StoreError)
    def store(_: Request, error: StoreError) -> JSONResponse:
        return problem_response(422, str(error))

    @app.exception_handler(Exception)
    def bug(_: Request, error: Exception) -> JSONResponse:
        # What went wrong inside is for the log, not for the client.
        return problem_response(500, "the service failed; its log has the details")
