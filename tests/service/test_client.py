"""The client for people's programs, against the OpenAPI document and against a running coordinator."""

import json

import pytest

from service.app import create_app
from service.client import ROUTES, Client, ClientError
from service.coordinator import Coordinator
from service.store import Store
from service.store.records import Filter
from service.store.seeds import SeedsWanted
from tests.service.campaigns import finish, spec_fields, submitted


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    with Store(tmp_path_factory.mktemp("document")) as store:
        return create_app(store).openapi()


@pytest.fixture
def running(tmp_path):
    with Coordinator(tmp_path) as coordinator, Client(coordinator.url) as client:
        yield coordinator.store, client


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


def test_what_was_found_is_read_page_by_page(running):
    store, client = running
    campaign_id = submitted(store, spec_fields(guesses=24))
    finish(store)
    page = client.solutions(campaign_id, strict=True, limit=1)
    following = client.solutions(campaign_id, strict=True, limit=1, after=page.next)
    listed = [item.id for item in (*page.items, *following.items)]
    assert listed == [record.id for record in store.all_records(Filter(campaign=campaign_id, strict=True), 2)]
    assert client.record(page.items[0].id).x
    seeds = client.seeds_of_search(campaign_id, "s1-0", SeedsWanted(limit=3))
    assert len(seeds.items) == 3 and seeds == store.seeds_of_search(campaign_id, "s1-0", SeedsWanted(limit=3))
    problem = client.solutions(campaign_id, "s1-0").items[0].problem_hash
    wanted = SeedsWanted(order="delta_v", mapping=("reference",))
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


def test_a_report_may_be_larger_than_what_people_send(client):
    padding = " " * (600 * 1024)
    report = {"job_id": 1, "attempt": 1, "outcome": {"ending": "crash"}}
    as_json = {"Content-Type": "application/json"}
    answer = client.post("/api/v1/jobs/complete", content=json.dumps(report) + padding, headers=as_json)
    assert answer.status_code == 404 and "job 1: expected one that exists" in answer.json()["detail"]
    assert client.post("/api/v1/campaigns", content="{}" + padding, headers=as_json).status_code == 413
