"""Completes the OpenAPI document: an example for each body and answer, and error responses (RFC 9457)."""

import json
from http import HTTPStatus
from importlib.resources import files
from typing import Any

from fastapi import FastAPI

JSON = "application/json"
PROBLEM = "application/problem+json"
#: By schema, or by operation where a body or an answer has none of its own; made by `make examples`.
EXAMPLES = files("service.api") / "examples.json"
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
CODES = {409: "stale_attempt"}


def finish_document(app: FastAPI) -> None:
    """Make an application serve the completed document."""
    made = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            _finish(made())
        return app.openapi_schema or {}

    # The way that FastAPI's manual shows.
    app.openapi = openapi  # type: ignore[method-assign]


def _finish(document: dict[str, Any]) -> None:
    _show(document, json.loads(EXAMPLES.read_text(encoding="utf-8")))
    for verbs in document["paths"].values():
        for operation in verbs.values():
            for status, answer in operation["responses"].items():
                if status >= "400":
                    _finish_refusal(int(status), answer)


def _show(document: dict[str, Any], examples: dict[str, Any]) -> None:
    schemas = document["components"]["schemas"]
    for name in examples["schemas"].keys() & schemas.keys():
        schemas[name]["examples"] = [examples["schemas"][name]]
    for line, sides in examples["operations"].items():
        verb, path = line.split(" ")
        operation = document["paths"][path][verb.lower()]
        if "request" in sides:
            operation["requestBody"]["content"][JSON]["example"] = sides["request"]
        if "answer" in sides:
            operation["responses"]["200"]["content"][JSON]["example"] = sides["answer"]


def _finish_refusal(status: int, answer: dict[str, Any]) -> None:
    content = answer.get("content", {})
    ours = content.pop(JSON, {})
    shown = content.setdefault(PROBLEM, {})
    shown.setdefault("schema", ours.get("schema", {"$ref": "#/components/schemas/Fault"}))
    shown.setdefault("example", _problem(status))
    answer["content"] = content


def _problem(status: int) -> dict[str, Any]:
    fault = {"type": "about:blank", "title": HTTPStatus(status).phrase, "status": status}
    code = {"code": CODES[status]} if status in CODES else {}
    return fault | {"detail": DETAILS.get(status, "see the title")} | code
