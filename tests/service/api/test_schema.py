"""Every operation of the OpenAPI document, asked what it allows and what not: the answer is as declared.

The archive behind it is that of a campaign at work: solutions, jobs in every state, events, leases.
"""

import re

import pytest
import schemathesis
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from schemathesis import GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi import checks

from service.app import create_app
from service.auth.network import Access
from service.dashboard.assets import VIEWS
from service.schemas.identity import Role
from service.schemas.solution import Filter
from service.settings import Settings
from service.store.store import Store
from tests.service.campaigns import finish, spec_fields, submitted
from tests.service.routes import lines_of
from tests.workers.jobs import worker_info

#: What allowed data may still be refused for (a row that is not there, fields that do not go together) no
#: schema says, so that data which the schema allows is accepted is not among these.
CHECKS = [
    not_a_server_error,
    checks.status_code_conformance,
    checks.content_type_conformance,
    checks.response_headers_conformance,
    checks.response_schema_conformance,
    checks.negative_data_rejection,
]
# The file of a campaign is bytes to it, like any other.
schemathesis.serializer.alias("application/zip", "application/octet-stream")
#: Requests per operation, allowed and not; 25 s for all of them on two slow cores.
N_EXAMPLES = 8
#: What is over in a second takes a busy machine longer.
PATIENCE_S = 120.0
OPERATIONS = sorted(
    (verb.upper(), path)
    for path, verbs in create_app(None, access=Access()).openapi()["paths"].items()
    for verb in verbs
)


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    with Store(tmp_path_factory.mktemp("archive")) as opened:
        submitted(opened)
        finish(opened)
        submitted(opened, spec_fields(guesses=40))
        worker = worker_info("node7:1")
        tickets = opened.claim(worker, 12)
        opened.cancel_job(tickets[0].job_id)
        yield opened


@pytest.fixture(scope="module")
def token(store):
    return store.identities.create("ada", Role.ADMIN, 1.0).token


@pytest.fixture(scope="module")
def schema(store, token):
    limits = Settings(requests_per_second=1e6, request_burst=1_000_000)
    # A stream would go on for minutes: this service is about to stop.
    app = create_app(store, lambda: True, Access(is_open=False, settings=limits))
    return schemathesis.openapi.from_asgi("/api/v1/openapi.json", app, headers=headers_of(token))


def headers_of(token):
    return {"Authorization": f"Bearer {token}", "Host": "127.0.0.1:8741"}


@pytest.fixture(scope="module")
def known(store):
    """Values of the archive by the name of a parameter, since guessed ones lead nowhere."""
    solutions = store.records(Filter(), 50).items
    jobs = [job.id for state in ("running", "queued", "done") for job in store.jobs(2, None, state, 3).items]
    found = {
        "campaign_id": [1, 2],
        "campaign": ["1", "2"],
        "name": ["s0", "s1-0"],
        "search": ["s0", "s1-0"],
        "job_id": [*jobs, 1],
        "solution_id": [record.id for record in solutions],
        "problem_hash": [record.problem_hash for record in solutions],
        "problem": [record.problem_hash for record in solutions],
    }
    return {name: st.sampled_from(values) for name, values in found.items()}


def requests_of(operation, known):
    """Return requests that the document allows, some about what the archive has, and some that it forbids."""
    allowed = operation.as_strategy()
    takes_something = operation.body or operation.query or operation.path_parameters
    forbidden = operation.as_strategy(generation_mode=GenerationMode.NEGATIVE)
    real = st.tuples(allowed, st.fixed_dictionaries(known)).map(lambda drawn: filled(*drawn))
    return st.one_of(allowed, real, forbidden) if takes_something else allowed


def filled(case, values):
    path, body = case.path_parameters or {}, case.body
    path.update({name: values[name] for name in path if name in values})
    if case.operation.path.endswith("/seeds"):
        kinds = [("campaign", "search"), ("problem",)]
        case.query = {name: values[name] for name in kinds[len(case.query or {}) % 2]}
    if isinstance(body, dict) and "job_id" in body:
        body |= {"job_id": values["job_id"], "attempt": 1}
    return case


def test_the_document_has_every_route_of_the_api_and_its_health(schema):
    pages = {"/static/{}", "/sign-in", "/sign-out", "/api/v1/openapi.json"}
    pages |= {re.sub("{[^}]*}", "{}", view.path) for view in VIEWS}
    routes = {line for line in lines_of(schema.app) if line.split(" ")[1] not in pages}
    ours = {f"{result.ok().method.upper()} {result.ok().path}" for result in schema.get_all_operations()}
    assert len(ours) == len(routes) - 3  # health and metrics have two addresses each
    assert ours == {" ".join(operation) for operation in OPERATIONS}


@pytest.mark.parametrize(("verb", "path"), OPERATIONS, ids=map(" ".join, OPERATIONS))
def test_an_operation_answers_as_the_document_says(store, schema, known, token, verb, path):
    operation = schema[path][verb]

    # The archive changes from one request to the next, so examples must not be tried again in another order.
    @settings(
        max_examples=N_EXAMPLES,
        deadline=None,
        database=None,
        derandomize=True,
        suppress_health_check=list(HealthCheck),
    )
    @given(case=requests_of(operation, known))
    def ask(case):
        # Else the service may find itself unready.
        store.register(worker_info("node7:1"))
        answer = case.call(headers=headers_of(token), timeout=PATIENCE_S)
        # A body that is too large is refused unread, which the checks do not take for a refusal.
        if answer.status_code != 413:
            case.validate_response(answer, checks=CHECKS)
        if answer.status_code >= 400:
            assert answer.headers["content-type"] == ["application/problem+json"]

    ask()


@pytest.mark.parametrize(
    "body", [b"\xff\xfe", '{"name": "ü"}'.encode("latin-1"), b"[" * 100_000], ids=["bytes", "latin-1", "deep"]
)
def test_a_body_that_is_no_json_means_nothing(client, body):
    answer = client.post("/api/v1/campaigns", content=body, headers={"content-type": "application/json"})
    assert answer.status_code == 422 and "body: expected JSON" in answer.json()["detail"]
