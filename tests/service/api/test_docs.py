"""The pages about the API and about deploying against the application, and the document that it gives out."""

import json
import re
from pathlib import Path

import jsonschema
import pytest
import typer.main

from core.nlp import ExitStatus
from service.api.document import EXAMPLES
from service.api.health import _places, _work, _writes
from service.app import create_app
from service.auth.guard import MAX_CLIENTS
from service.auth.network import (
    MAX_BODY_BYTES,
    MAX_PORTABLE_BYTES,
    MAX_REPORT_BYTES,
    MAX_TARGET_BYTES,
    PORTABLE_PATH,
    REPORT_PATHS,
)
from service.auth.request_limits import PATIENCE_S
from service.auth.rights import RIGHTS, least, line_of
from service.cli import app_of
from service.settings import Settings
from service.store import leases
from service.store.statistics import Reading
from tests.service.routes import lines_of
from workers.messages import Ending

DOCS = Path(__file__).parents[3] / "docs"
API = (DOCS / "api.md").read_text(encoding="utf-8")
SECURITY = (DOCS / "security.md").read_text(encoding="utf-8")
DEPLOY = (DOCS / "deploy.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (`(?:GET|HEAD|POST|PUT|PATCH|DELETE) [^|]*) \| (\w+) \|", API, re.MULTILINE)
#: Role by route, as documented.
ROLES = {
    line_of(*route.split(" ")): role for routes, role in ROWS for route in re.findall(r"`([^`]*)`", routes)
}


def test_every_route_is_documented_with_its_role_and_no_other(store):
    routes = set(lines_of(create_app(store)))
    assert set(ROLES) == routes
    for line, role in ROLES.items():
        assert role == ("anyone" if RIGHTS[line] is None else least(RIGHTS[line])), line


def command_names(command, name="coastarc"):
    inner = getattr(command, "commands", None)
    if inner is None:
        return [name]
    return [full for word, one in inner.items() for full in command_names(one, f"{name} {word}")]


@pytest.mark.parametrize("name", command_names(typer.main.get_command(app_of())))
def test_every_command_is_documented(name):
    assert re.search(rf"`{name}( [A-Z]+)*`", API), name


def test_the_limits_in_the_documents_are_those_of_the_service():
    allowed = Settings()
    assert (
        f"at most {MAX_BODY_BYTES // 2**10} kB" in SECURITY and f"{MAX_REPORT_BYTES // 2**20} MB" in SECURITY
    )
    assert f"at most {MAX_TARGET_BYTES // 2**10} kB" in SECURITY and f"within {PATIENCE_S:.0f} s" in SECURITY
    assert all(f"`{path}`" in SECURITY for path in (*REPORT_PATHS, PORTABLE_PATH))
    assert f"{MAX_PORTABLE_BYTES // 2**30} GiB" in SECURITY
    assert f"{MAX_CLIENTS:_}".replace("_", " ") in SECURITY
    bucket = f"{allowed.request_burst} at once and then {allowed.requests_per_second:.0f} a second"
    workers = f"{allowed.worker_request_burst}\nand {allowed.worker_requests_per_second:.0f}"
    assert bucket in SECURITY and workers in SECURITY
    assert f"{allowed.streams_per_client} event streams" in SECURITY
    kept = f"{leases.AUDIT_ROWS:_} rows of the last {leases.AUDIT_S / leases.DAY_S:.0f} days"
    assert kept.replace("_", " ") in SECURITY
    assert f"newest {leases.EVENT_ROWS:_} events".replace("_", " ") in API


def test_every_metric_is_documented():
    reading = Reading({}, {}, {}, {}, {}, 0, 0, 0, 0.0, 0)
    families = [*_work(reading), *_places(reading, 0), *_writes([0] * 13, 0.0, 0)]
    for family in families:
        name = family.name + ("_total" if family.type == "counter" else "")
        assert f"`{name}" in DEPLOY, name


@pytest.fixture
def operations(client):
    paths = client.get("/api/v1/openapi.json").json()["paths"]
    return {
        f"{verb.upper()} {path}": operation
        for path, verbs in paths.items()
        for verb, operation in verbs.items()
    }


def test_every_operation_has_a_summary_and_says_how_it_refuses(operations):
    for name, operation in operations.items():
        assert operation["summary"], name
        refusals = [status for status in operation["responses"] if status >= "400"]
        assert {"401", "403", "422", "429", "503"} <= set(refusals), name
        for status in refusals:
            assert "application/problem+json" in operation["responses"][status]["content"], (name, status)


def has_example(content, schemas):
    schema = content.get("schema", {})
    name = schema.get("$ref", "").rpartition("/")[2]
    return bool(
        {"example", "examples"} & content.keys()
        or {"example", "examples"} & schema.keys()
        or {"example", "examples"} & schemas.get(name, {}).keys()
    )


def test_every_operation_has_an_example_of_what_it_takes_and_answers(client, operations):
    schemas = client.get("/api/v1/openapi.json").json()["components"]["schemas"]
    for name, operation in operations.items():
        body = operation.get("requestBody", {"content": {}})["content"]
        for content in body.values():
            assert has_example(content, schemas), f"body of {name}"
        for status, answer in operation["responses"].items():
            if status < "300":
                for kind, content in answer.get("content", {}).items():
                    assert has_example(content, schemas), f"{kind} {status} of {name}"


SHOWN = json.loads(EXAMPLES.read_text(encoding="utf-8"))


@pytest.fixture
def document(client):
    return client.get("/api/v1/openapi.json").json()


def test_the_examples_are_of_schemas_and_operations_that_there_are(document, operations):
    # Else `make examples`.
    assert SHOWN["schemas"].keys() <= document["components"]["schemas"].keys()
    assert SHOWN["operations"].keys() <= operations.keys()


@pytest.mark.parametrize("name", SHOWN["schemas"])
def test_an_example_of_a_schema_is_valid(document, name):
    schema = {"$ref": f"#/components/schemas/{name}", "components": document["components"]}
    jsonschema.validate(SHOWN["schemas"][name], schema)


def words_of(value, key):
    """Return all text that stands under a key, however deep."""
    if isinstance(value, list):
        return [word for part in value for word in words_of(part, key)]
    if not isinstance(value, dict):
        return []
    here = [] if isinstance(value.get(key), int) else value.get(key)
    own = [here] if isinstance(here, str) else [word for word in here or [] if isinstance(word, str)]
    return own + [word for part in value.values() for word in words_of(part, key)]


def test_the_statuses_and_endings_in_the_examples_are_those_of_solves():
    statuses = {word for key in ("status", "statuses") for word in words_of(SHOWN, key)}
    endings = {word for key in ("ending", "endings") for word in words_of(SHOWN, key)}
    assert statuses and statuses <= ExitStatus.__members__.keys()
    assert endings and endings <= {ending.value for ending in Ending}
