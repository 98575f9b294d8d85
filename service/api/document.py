"""The OpenAPI document, finished: an example for each body and answer, refusals as the problems they are."""

from http import HTTPStatus
from typing import Any

from fastapi import FastAPI

from service.schemas import (
    activity_examples,
    campaign_examples,
    certificate_examples,
    examples,
    missed_thrust_examples,
)
from service.schemas.examples import TRAJECTORY

PROBLEM = "application/problem+json"
#: What a refusal of each status says.
DETAILS = {
    401: "Authorization: expected Bearer and a token, got none",
    403: "POST /api/v1/campaigns: expected role submitter, got viewer",
    404: "campaign 99: expected one that exists, got none with this id",
    409: "job 17: expected attempt 1 to hold it, got a stale report",
    413: "body: expected at most 524288 bytes, got 1048576",
    422: "request.query.limit: expected a number of at most 200, got '1000'",
    429: "requests: expected fewer of them, got too many at once; wait 3 s",
    503: "archive: expected to take a write, got a fault; what was stored before is kept",
}
#: By the model of the answer.
EXAMPLES = (
    examples.EXAMPLES
    | certificate_examples.EXAMPLES
    | campaign_examples.EXAMPLES
    | activity_examples.EXAMPLES
    | missed_thrust_examples.EXAMPLES
)
CODES = {409: "stale_attempt"}
#: Answers without a model.
BARE = {"/api/v1/solutions/{solution_id}/trajectory": TRAJECTORY}


def finish_document(app: FastAPI) -> None:
    """Have an application give out the finished document."""
    made = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            _finish(made())
        return app.openapi_schema or {}

    # The way that FastAPI's manual shows.
    app.openapi = openapi  # type: ignore[method-assign]


def _finish(document: dict[str, Any]) -> None:
    schemas = document["components"]["schemas"]
    for model, example in EXAMPLES.items():
        if model.__name__ in schemas:
            schemas[model.__name__]["examples"] = [example]
    for path, verbs in document["paths"].items():
        for operation in verbs.values():
            for status, answer in operation["responses"].items():
                if status >= "400":
                    _finish_refusal(int(status), answer)
                elif path in BARE and status < "300":
                    answer["content"]["application/json"]["example"] = BARE[path]


def _finish_refusal(status: int, answer: dict[str, Any]) -> None:
    content = answer.get("content", {})
    ours = content.pop("application/json", {})
    shown = content.setdefault(PROBLEM, {})
    shown.setdefault("schema", ours.get("schema", {"$ref": "#/components/schemas/Fault"}))
    shown.setdefault("example", _problem(status))
    answer["content"] = content


def _problem(status: int) -> dict[str, Any]:
    fault = {"type": "about:blank", "title": HTTPStatus(status).phrase, "status": status}
    code = {"code": CODES[status]} if status in CODES else {}
    return fault | {"detail": DETAILS.get(status, "see the title")} | code
