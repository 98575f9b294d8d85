"""A PostgreSQL that stops under a service, as at once as it can, and is started again."""

import os
import signal
import threading
import time

import httpx
import pytest
from fastapi.testclient import TestClient

from service.app import create_app
from service.auth.network import Access
from service.coordinator import Coordinator, WorkerSetup, coordinator
from service.coordinator.coordinator import read_history
from service.db.engine import database_url
from service.db.errors import DatabaseError, UnavailableError
from service.scheduler import LeaseSettings
from service.schemas.identity import Role
from service.settings import Settings
from service.store.store import Store
from tests.api_examples import example_of
from tests.service.api.test_schema import OPERATIONS
from tests.service.campaigns import content, dispatcher_pid, finish, spec_fields, submitted
from tests.service.coordinator.test_dispatch import SLOW, undisturbed, wait_for
from tests.service.databases import needs_postgres, rows
from tests.workers.jobs import worker_info
from workers.dispatch import ExecutorKind
from workers.messages import HandInRequest

pytestmark = [pytest.mark.postgres, needs_postgres]

#: What asks nothing of the archive.
UNCONCERNED = {
    ("GET", "/healthz"),
    ("GET", "/readyz"),
    ("GET", "/api/v1/session"),
    ("POST", "/api/v1/session"),
    ("DELETE", "/api/v1/session"),
    ("POST", "/api/v1/specs/check"),
    ("GET", "/api/v1/specs/templates"),
}
ID = "0" * 32


@pytest.fixture
def expected(tmp_path):
    """What the campaign finds, on an archive of its own: asked for before the place is another."""
    return undisturbed(tmp_path / "undisturbed", guesses=40)


@pytest.fixture
def url(own_postgres, monkeypatch):
    found = database_url(own_postgres.address(own_postgres.take()))
    monkeypatch.setattr("service.store.archive.place_of", lambda folder: found)
    return found


@pytest.fixture
def store(url, tmp_path):
    with Store(tmp_path) as opened:
        submitted(opened)
        finish(opened)
        submitted(opened, spec_fields(guesses=40))
        yield opened


@pytest.fixture
def away(own_postgres):
    """Return a function that stops the server; it runs again afterwards."""
    stopped = []

    def stop():
        own_postgres.stop()
        stopped.append(True)

    def go_on():
        while stopped:
            own_postgres.go_on()
            stopped.pop()

    stop.go_on = go_on
    yield stop
    go_on()


def test_reads_and_writes_are_refused_until_the_server_is_back(store, away):
    away()
    for _ in range(2):  # connections that broke, and such as are refused
        with pytest.raises(UnavailableError, match="expected a server that answers"):
            store.campaigns()
        with pytest.raises(UnavailableError, match="expected a server that answers"):
            store.claim("w", 1)
    away.go_on()
    assert len(store.campaigns()) == 2 and len(store.claim("w", 1)) == 1


def asked(client, verb, path):
    path = path.replace("{campaign_id}", "2").replace("{job_id}", "1").replace("{name}", "s0")
    for name in ("solution_id", "problem_hash", "certificate_id"):
        path = path.replace(f"{{{name}}}", ID)
    bodies = {
        "/api/v1/campaigns": spec_fields(3),
        "/api/v1/problems": {"preset": "ppe-drm3"},
        "/api/v1/jobs/claim": {"worker": worker_info().model_dump(), "n_jobs": 1},
        "/api/v1/jobs/heartbeat": {"worker": worker_info().model_dump()},
        "/api/v1/jobs/hand-in": example_of(HandInRequest).model_dump(mode="json"),
        "/api/v1/jobs/complete": {"job_id": 1, "attempt": 1, "outcome": {"ending": "crash"}},
        "/api/v1/jobs/complete-many": {
            "reports": [{"job_id": 1, "attempt": 1, "outcome": {"ending": "crash"}}]
        },
        "/api/v1/tokens": {"name": "a", "role": "viewer"},
    }
    body = bodies.get(path, {"priority": 1} if path.endswith("priority") else {"weight": 1.0})
    query = {"campaign": 2, "search": "s0"} if path.endswith("/seeds") else {}
    return client.request(verb, path, params=query, json=body if verb == "POST" else None)


def test_every_route_says_that_the_archive_is_away_and_the_service_is_alive(store, away, caplog):
    app = create_app(store, access=Access())
    with TestClient(app, base_url="http://127.0.0.1:8741", raise_server_exceptions=False) as client:
        away()
        wrong = {}
        for verb, path in OPERATIONS:
            if (verb, path) in UNCONCERNED:
                continue
            answer = asked(client, verb, path)
            seen = answer.status_code, answer.headers.get("Retry-After"), answer.headers["content-type"]
            if seen != (503, "5", "application/problem+json") and "import" not in path:
                wrong[verb, path] = seen
        assert wrong == {}
        for format in ("csv", "ndjson"):
            assert client.get("/api/v1/solutions", params={"format": format}).status_code == 503
        assert client.get("/healthz").status_code == 200 and client.get("/readyz").status_code == 503
        away.go_on()
        assert client.get("/api/v1/campaigns").status_code == 200
        assert client.post("/api/v1/campaigns/2/priority", json={"priority": 1}).status_code == 200
    told = [record.getMessage() for record in caplog.records if record.name == "workers.retry"]
    # However many asked: when it began, and when it was over.
    assert len(told) == 2 and "start PostgreSQL" in told[0] and "archive: works again" in told[1]


def test_pages_and_tokens_are_refused_too_where_nobody_can_be_known(store, away):
    made = store.identities.create("ada", Role.ADMIN, 1.0)
    app = create_app(store, access=Access(is_open=False, settings=Settings()))
    with TestClient(app, base_url="http://127.0.0.1:8741", raise_server_exceptions=False) as client:
        away()
        for path in ("/", "/campaigns/1", "/api/v1/campaigns", "/metrics"):
            answer = client.get(path, headers={"Authorization": f"Bearer {made.token}"})
            assert (answer.status_code, answer.headers["Retry-After"]) == (503, "5")
            assert "secret" not in answer.text and "socket" not in answer.text


def test_an_open_stream_of_events_outlives_the_absence(url, tmp_path, away):
    with Coordinator(tmp_path) as running:
        campaign = submitted(running.store)
        path = f"{running.url}/api/v1/campaigns/{campaign}/events"
        with httpx.stream("GET", path, trust_env=False, timeout=60.0) as stream:
            lines = stream.iter_lines()
            first = next(line for line in lines if line.startswith("data:"))
            away()
            time.sleep(1.2)  # it looks twice a second
            away.go_on()
            running.store.control_campaign(campaign, "pause")
            assert "paused" in next(line for line in lines if line.startswith("data:") and line != first)


def test_a_coordinator_waits_for_a_server_that_is_not_there_yet(url, tmp_path, away, monkeypatch, caplog):
    monkeypatch.setattr(coordinator, "DATABASE_PERIOD_S", 0.1)
    away()
    threading.Timer(1.0, away.go_on).start()
    with Coordinator(tmp_path) as running:
        assert running.store.campaigns() == []
    told = [record.getMessage() for record in caplog.records if record.name == "workers.retry"]
    assert len(told) == 1 and "it is asked again every" in told[0]


def test_a_server_that_refuses_the_name_of_the_database_is_not_waited_for(
    own_postgres, tmp_path, monkeypatch
):
    place = database_url(own_postgres.address("none"))
    monkeypatch.setattr("service.store.archive.place_of", lambda folder: place)
    with pytest.raises(DatabaseError, match='"none" does not exist'), Coordinator(tmp_path):
        pass


def test_reading_ahead_goes_on_when_the_server_is_back(store, away, monkeypatch):
    monkeypatch.setattr("service.coordinator.coordinator.OUTAGE_PAUSE_S", 0.1)
    away()
    reader = threading.Thread(target=read_history, args=(store, threading.Event()))
    reader.start()
    time.sleep(0.5)
    assert reader.is_alive()
    away.go_on()
    reader.join(60.0)
    assert not reader.is_alive()


@pytest.mark.slow
@pytest.mark.parametrize("dies", [False, True])
def test_outcomes_that_end_while_the_server_is_away_are_handed_in_and_nothing_runs_twice(
    expected, url, tmp_path, away, dies
):
    leases = LeaseSettings(lease_s=20.0, heartbeat_s=1.0, reap_s=0.5)
    outbox = tmp_path / "away" / "outbox"
    with Coordinator(tmp_path / "away", leases=leases) as running:
        campaign = submitted(running.store, spec_fields(40))
        running.work(WorkerSetup(2, ExecutorKind.PROCESS, SLOW), campaign)
        wait_for(lambda: len(running.store.jobs(campaign, None, "done", 200).items) >= 2)
        away()
        # One at least is at work; whatever was between two jobs has none.
        wait_for(lambda: list(outbox.glob("*.json")))
        time.sleep(0.5)
        kept = sorted(int(path.name.split("-")[1]) for path in outbox.glob("*.json"))
        if dies:
            os.kill(dispatcher_pid(running), signal.SIGKILL)
        away.go_on()
        wait_for(lambda: running.store.campaign(campaign).state == "done")
        assert content(running.store) == expected and list(outbox.glob("*.json")) == []
        # What waited was taken as it was, and not lost and found again.
        again = rows(running.store, "SELECT job_id FROM attempt WHERE attempt > 1")
        assert kept and not {job_id for (job_id,) in again}.intersection(kept)
