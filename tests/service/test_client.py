"""The client for people's programs, against the OpenAPI document and against a running coordinator."""

import itertools
import json
import re
from pathlib import Path

import httpx
import pytest

from core.errors import UserError
from service.app import create_app
from service.client import ROUTES, Client, ClientError
from service.coordinator import Coordinator
from service.schemas.solution import Filter
from service.spec.spec import SeedChoices
from service.store import campaigns
from service.store.store import Store
from tests.service.campaigns import finish, spec_fields, submitted
from tests.workers.jobs import worker_info
from workers.client import Api, HttpSource
from workers.messages import (
    ClaimAnswer,
    ClaimRequest,
    CompleteAnswer,
    CompleteRequest,
    Ended,
    Ending,
    Finished,
    HeartbeatAnswer,
    HeartbeatRequest,
    Sealed,
    Ticket,
)


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    with Store(tmp_path_factory.mktemp("document")) as store:
        return create_app(store).openapi()


@pytest.fixture
def running(tmp_path):
    with Coordinator(tmp_path) as coordinator, Client(coordinator.url) as client:
        yield coordinator.store, client


#: Every method, with all that it takes.
CALLS = {
    "import_campaign": (Path(__file__),),
    "export_campaign": (1,),
    "submit": ({"campaign": {}}, "key-1"),
    "control_campaign": (1, "pause"),
    "control_search": (1, "s0", "resume"),
    "set_campaign_priority": (1, -1),
    "set_search_priority": (1, "s0", -1),
    "set_search_weight": (1, "s0", 2.0),
    "cancel_job": (1,),
    "requeue_job": (1,),
    "campaigns": (),
    "campaign": (1,),
    "find_campaign": ("quick",),
    "solutions": (1, "s0", True, 3, "a"),
    "record": ("0" * 32,),
    "reproduction": ("0" * 32,),
    "missed_thrust": ("0" * 32, 7, 2),
    "problem": ("0" * 32,),
    "seeds_of_search": (1, "s0", SeedChoices("delta_v", 3, "paper", ("reference",))),
    "seeds_of_problem": ("0" * 32, [(24, 1.0)], 1, SeedChoices("delta_v", 3, "paper", ("reference",))),
    "jobs": (1, "s0", "dead", 3, 5),
    "job": (1,),
    "workers": (),
    "events": (5, 1, 3),
    "follow": (1, 5),
}
#: What the query says of these calls.
QUERIES = {
    "find_campaign": {"name"},
    "solutions": {"campaign", "search", "strict", "limit", "after"},
    "seeds_of_search": {"campaign", "search", "order", "limit", "tolerance", "mapping"},
    "seeds_of_problem": {"problem", "outage", "k", "order", "limit", "tolerance", "mapping"},
    "missed_thrust": {"campaign", "limit"},
    "jobs": {"campaign", "search", "state", "limit", "after"},
    "events": {"after", "campaign", "limit"},
}


#: The same specification twice is one campaign.
RNG_SEEDS = itertools.count()


#: What a dispatcher reports of an attempt.
CRASHED = Finished(Ticket(1, 1), Sealed(Ended(ending=Ending.CRASH)))


class SentError(Exception):
    """What a client sends; raised in place of an answer."""


def refuse(request):
    raise SentError(request)


def operation_of(document, request):
    """Return the operation that a request reaches."""
    path = request.url.path
    found = [
        verbs[request.method.lower()]
        for template, verbs in document["paths"].items()
        if re.fullmatch(re.sub("{[^}]*}", "[^/]+", template), path) and request.method.lower() in verbs
    ]
    # /jobs/claim and the like are no ids.
    assert found, f"{request.method} {path}"
    return found[-1]


def request_of(api, call):
    api._http = httpx.Client(base_url=api._http.base_url, transport=httpx.MockTransport(refuse))
    with pytest.raises(SentError) as asked:
        call()
    api._http.close()
    return asked.value.args[0]


def test_every_method_is_asked_here():
    methods = {name for name in vars(Client) if not name.startswith("_")}
    assert methods == set(CALLS)


@pytest.mark.parametrize("method", CALLS)
def test_a_method_asks_what_the_document_has(method, document):
    with Client("http://node7:8741") as client:
        answer = lambda: getattr(client, method)(*CALLS[method])  # noqa: E731
        is_stream = method in ("follow", "export_campaign")
        request = request_of(client._api, lambda: next(answer()) if is_stream else answer())
    operation = operation_of(document, request)
    known = {one["name"] for one in operation.get("parameters", ())}
    assert set(request.url.params) == QUERIES.get(method, set()) <= known
    headers = {"submit": "idempotency-key", "follow": "last-event-id"}
    assert headers.get(method, "host") in request.headers and known >= {*filter(None, [headers.get(method)])}


@pytest.mark.parametrize(
    ("verb", "asks", "body", "answers"),
    [
        ("claim", ClaimRequest(worker=worker_info(), n_jobs=1), ClaimRequest, ClaimAnswer),
        ("heartbeat", HeartbeatRequest(worker=worker_info(), held=()), HeartbeatRequest, HeartbeatAnswer),
        ("complete", CRASHED, CompleteRequest, CompleteAnswer),
    ],
)
def test_a_dispatcher_asks_what_the_document_has(document, verb, asks, body, answers):
    with Api("http://node7:8741") as api:
        request = request_of(api, lambda: getattr(HttpSource(api), verb)(asks))
    operation = operation_of(document, request)
    assert operation == document["paths"][f"/api/v1/jobs/{verb}"]["post"]
    (content,), answer = operation["requestBody"]["content"].values(), operation["responses"]["200"]
    assert body.__name__ in str(content["schema"]) and answers.__name__ in str(answer)


@pytest.mark.parametrize("route", ROUTES.values(), ids=ROUTES)
def test_every_route_it_asks_is_in_the_document_with_that_answer(route, document):
    operation = document["paths"][f"/api/v1{route.path}"][route.verb.lower()]
    success = next(
        operation["responses"][status] for status in ("200", "201") if status in operation["responses"]
    )
    assert route.answer.__name__ in str(success) or "text/event-stream" in success["content"]
    assert set(route.query) <= {parameter["name"] for parameter in operation.get("parameters", ())}
    fields = document["components"]["schemas"][route.answer.__name__]["properties"]
    assert set(fields) == set(route.answer.model_json_schema(mode="serialization")["properties"])


def test_a_campaign_is_submitted_paused_resumed_and_cancelled(running):
    _, client = running
    view, is_new = client.submit(spec_fields(), key="once")
    assert is_new and not client.submit(spec_fields(), key="once")[1]
    assert client.find_campaign("test") == client.find_campaign(str(view.id)) == view.id
    assert client.control_campaign(view.id, "pause").state == "paused"
    assert client.control_campaign(view.id, "resume").state == "active"
    searches = client.control_search(view.id, "s0", "pause").searches
    assert [search.state for search in searches] == ["paused", "waiting"]
    assert client.control_campaign(view.id, "cancel").state == "cancelled"


def test_a_campaign_is_found_by_id_and_then_by_name_with_and_without_a_coordinator(running):
    store, client = running
    ids = [submitted(store, _named_campaign(name)) for name in ("7", "mine", "mine", "1")]
    for source in (client, store):
        # The last is named as the first is numbered.
        assert [source.find_campaign(wanted) for wanted in ("7", "mine", "2", "1")] == [1, 3, 2, 1]
        with pytest.raises(UserError, match="campaign 99: expected one that exists, got none with this name"):
            source.find_campaign("99")
    assert ids == [1, 2, 3, 4]


def test_a_campaign_is_found_however_many_are_newer(running, monkeypatch):
    store, client = running
    old = submitted(store, _named_campaign("old"))
    submitted(store, _named_campaign("new"))
    monkeypatch.setattr(campaigns, "MOST_CAMPAIGNS", 1)
    assert [item.name for item in client.campaigns()] == ["new"]
    assert client.find_campaign("old") == store.find_campaign("old") == old


def _named_campaign(name):
    rng_seed = next(RNG_SEEDS)
    return spec_fields() | {"campaign": {"name": name, "rng_seed": rng_seed}}


def test_what_was_found_is_read_page_by_page(running):
    store, client = running
    campaign_id = submitted(store, spec_fields(guesses=24))
    finish(store)
    page = client.solutions(campaign_id, strict=True, limit=1)
    following = client.solutions(campaign_id, strict=True, limit=1, after=page.next)
    listed = [item.id for item in (*page.items, *following.items)]
    assert listed == [record.id for record in store.all_records(Filter(campaign=campaign_id, strict=True), 2)]
    assert client.record(page.items[0].id).x
    seeds = client.seeds_of_search(campaign_id, "s1-0", SeedChoices(limit=3))
    assert len(seeds.items) == 3 and seeds == store.seeds_of_search(campaign_id, "s1-0", SeedChoices(limit=3))
    problem = client.solutions(campaign_id, "s1-0").items[0].problem_hash
    wanted = SeedChoices(order="delta_v", mapping=("reference",))
    assert client.seeds_of_problem(problem, [(30, 1.0)], 0, wanted) == store.seeds_of_problem(
        problem, [(30, 1.0)], 0, wanted
    )
    jobs = client.jobs(campaign_id, None, "done", 50).items
    assert client.job(jobs[0].id) == jobs[0]
    assert client.workers() == store.workers()


def test_events_are_read_and_followed_from_where_one_left_off(running):
    store, client = running
    campaign_id = submitted(store)
    finish(store)
    events = client.events(0, campaign_id)
    stream = client.follow(campaign_id, after=events[3].id)
    assert [next(stream) for _ in range(3)] == events[4:7]
    stream.close()


def test_a_refusal_is_an_error_with_its_status_and_code(running):
    store, client = running
    with pytest.raises(ClientError, match="campaign 99: expected one that exists") as raised:
        client.campaign(99)
    assert raised.value.status == 404
    campaign_id = submitted(store)
    client.control_campaign(campaign_id, "cancel")
    with pytest.raises(ClientError) as raised:
        client.control_campaign(campaign_id, "resume")
    assert (raised.value.status, raised.value.code) == (409, "wrong_state")
    with pytest.raises(ClientError, match="campaign nobody: expected one that exists"):
        client.find_campaign("nobody")


def test_nobody_there_is_an_error_with_advice():
    with Client("http://127.0.0.1:9") as client, pytest.raises(ClientError, match="coastarc serve") as raised:
        client.campaigns()
    assert raised.value.status is None


@pytest.mark.parametrize(
    ("reply", "reason"),
    [
        (httpx.Response(200, html="<p>hello"), "expected one at http://node7:8741, got .* something else"),
        (
            httpx.Response(401, json={"detail": "token: none"}),
            "token: none; name a file .* COASTARC_TOKEN_FILE",
        ),
    ],
)
def test_another_service_and_a_missing_token_are_told_with_what_helps(reply, reason):
    with Client("http://node7:8741") as client:
        client._api._http = httpx.Client(
            base_url="http://node7:8741", transport=httpx.MockTransport(lambda _: reply)
        )
        with pytest.raises(ClientError, match=reason):
            client.campaigns()
        client._api._http.close()


def test_a_report_may_be_larger_than_what_people_send(client):
    padding = " " * (600 * 1024)
    report = {"job_id": 1, "attempt": 1, "outcome": {"ending": "crash"}}
    as_json = {"Content-Type": "application/json"}
    answer = client.post("/api/v1/jobs/complete", content=json.dumps(report) + padding, headers=as_json)
    assert answer.status_code == 404 and "job 1: expected one that exists" in answer.json()["detail"]
    assert client.post("/api/v1/campaigns", content="{}" + padding, headers=as_json).status_code == 413
