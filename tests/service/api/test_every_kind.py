"""Every GET route over an archive that holds each kind of campaign, asked about every row that there is."""

import itertools
import threading

import pytest
from fastapi.testclient import TestClient

from service.app import create_app
from service.auth.network import Access
from service.solutions.export import ExportFormat
from service.store.store import Store
from tests.service.databases import rows
from tests.service.kinds import every_kind
from tests.workers.jobs import worker_info

# Real solutions are flown and verified, which takes most of a minute.
pytestmark = pytest.mark.slow

ROUTES = {
    path: verbs["get"].get("parameters", [])
    for path, verbs in create_app(None, access=Access()).openapi()["paths"].items()
    if "get" in verbs
}
#: What a row has not: a certificate that nobody asked for; a file of a campaign that goes on.
REFUSALS = {
    "/api/v1/solutions/{solution_id}/certificate": {404},
    "/api/v1/campaigns/{campaign_id}/export": {409},
}
#: Kinds of a query's words that the document tells in prose alone.
WORDS = {"format": [one.value for one in ExportFormat], "what": ["states", "vector"]}


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    with Store(tmp_path_factory.mktemp("kinds")) as store:
        yield store, every_kind(store)


@pytest.fixture(scope="module")
def client(archive):
    closing = threading.Event()
    app = create_app(archive[0], closing.is_set, Access())
    with TestClient(app, base_url="http://127.0.0.1:8741", raise_server_exceptions=False) as opened:
        yield opened, closing


@pytest.fixture(scope="module")
def ids(archive):
    """The rows that a path or a query may name, by the name of the parameter."""
    store, _ = archive
    columns = {
        "solution_id": "SELECT id FROM solution",
        "job_id": "SELECT id FROM job",
        "problem_hash": "SELECT hash FROM problem",
        "campaign_id": "SELECT id FROM campaign",
    }
    found = {name: [row[0] for row in rows(store, query)] for name, query in columns.items()}
    return found | {
        "campaign": found["campaign_id"],
        "problem": found["problem_hash"],
        "robust": [row[0] for row in rows(store, "SELECT hash FROM problem WHERE k > 0")],
        "searches": rows(store, "SELECT campaign_id, name FROM search"),
        "seeded": rows(store, "SELECT campaign_id, name FROM search WHERE strategy LIKE '%|%'"),
    }


def test_the_archive_holds_each_kind_in_the_state_that_it_is_told_of(archive):
    store, kinds = archive
    states = {name: store.campaign(getattr(kinds, name)) for name in kinds._fields}
    ended = {name for name, campaign in states.items() if campaign.state == "done"}
    assert ended == {"quick", "cases", "missed_thrust", "refined", "imported", "failed"}
    assert {name for name in ended if not states[name].n_solutions} == {"failed"}
    assert [states[name].state for name in ("cancelled", "paused", "running")] == [
        "cancelled",
        "paused",
        "active",
    ]
    assert {search.name for search in states["quick"].searches if search.n_solutions} == {
        "s0",
        "s1-0",
        "s2-1",
    }


@pytest.mark.parametrize("path", ROUTES)
def test_a_get_route_answers_about_every_row(archive, client, ids, path):
    opened, closing = client
    # Without a worker that was seen lately the service is not ready.
    archive[0].heartbeat(worker_info("node7:1"), [])
    # Streams end at once, as they do when the service stops.
    (closing.set if path.endswith(("/events/stream", "}/events")) else closing.clear)()
    answers = {
        (address, str(query)): opened.get(address, params=query) for address, query in _requests(path, ids)
    }
    allowed = {200} | REFUSALS.get(path, set())
    assert answers and {key: one.text for key, one in answers.items() if one.status_code not in allowed} == {}


def _requests(path, ids):
    """Yield addresses and queries: each row alone, and the last with each word of each parameter."""
    names = [one["name"] for one in ROUTES[path] if one["in"] == "path"]
    optional = {
        one["name"]: one["schema"].get("enum") or WORDS.get(one["name"])
        for one in ROUTES[path]
        if one["in"] == "query"
    }
    if path == "/api/v1/seeds":
        yield from _about_seeds(path, ids)
        return
    queries = [{name: word} for name, words in optional.items() for word in words or ids.get(name, [])]
    places = (
        ids["searches"]
        if names == ["campaign_id", "name"]
        else itertools.product(*(ids[name] for name in names))
    )
    addresses = [path.format(**dict(zip(names, place, strict=True))) for place in places]
    yield from ((address, {}) for address in addresses)
    yield from ((addresses[-1], query) for query in queries)


def _about_seeds(path, ids):
    for campaign, search in ids["seeded"]:
        yield path, {"campaign": campaign, "search": search}
    for problem in ids["robust"]:
        yield path, {"problem": problem}
