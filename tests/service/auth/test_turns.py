"""Readers in any number leave a thread to workers and to probes, and those who wait too long are told."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest

from service.auth import guard
from service.auth.network import Access
from service.coordinator import WebServer, open_port
from service.store.store import Store
from tests.service.campaigns import submitted
from tests.workers.jobs import worker_info

API = "/api/v1"


class Patient:
    """A store whose list of campaigns takes until somebody lets go."""

    def __init__(self, store):
        self._store, self.may_go_on = store, threading.Event()
        self.n_inside, self.most_inside, self._lock = 0, 0, threading.Lock()

    def __getattr__(self, name):
        return getattr(self._store, name)

    def campaign_cards(self, name_or_id=None):
        with self._lock:
            self.n_inside += 1
            self.most_inside = max(self.most_inside, self.n_inside)
        self.may_go_on.wait(60)
        with self._lock:
            self.n_inside -= 1
        return self._store.campaign_cards()

    def wait_until_full(self):
        end = time.monotonic() + 60
        while self.n_inside < guard.READS and time.monotonic() < end:
            time.sleep(0.01)
        assert self.n_inside == guard.READS


@pytest.fixture
def served(tmp_path):
    with Store(tmp_path) as store:
        submitted(store)
        patient = Patient(store)
        server = WebServer(patient, open_port("127.0.0.1", 0), "127.0.0.1", Access())
        server.start()
        with httpx.Client(
            base_url=server.url, timeout=60, limits=httpx.Limits(max_connections=None)
        ) as client:
            yield patient, client
        patient.may_go_on.set()
        server.stop()


def test_workers_and_probes_are_answered_while_readers_wait(served):
    patient, client = served
    with ThreadPoolExecutor(60) as readers:
        answers = [readers.submit(client.get, f"{API}/campaigns") for _ in range(60)]
        patient.wait_until_full()
        worker = worker_info("node7:1").model_dump()
        claimed = client.post(f"{API}/jobs/claim", json={"worker": worker, "n_jobs": 1})
        beat = client.post(f"{API}/jobs/heartbeat", json={"worker": worker, "held": []})
        assert [claimed.status_code, beat.status_code, client.get("/healthz").status_code] == [200] * 3
        assert claimed.json()["claims"] and not any(answer.done() for answer in answers)
        patient.may_go_on.set()
        assert {answer.result().status_code for answer in answers} == {200}
    assert patient.most_inside == guard.READS


def test_who_gets_no_turn_in_time_is_told_to_come_back(served, monkeypatch):
    patient, client = served
    with ThreadPoolExecutor(guard.READS) as readers:
        inside = [readers.submit(client.get, f"{API}/campaigns") for _ in range(guard.READS)]
        patient.wait_until_full()
        monkeypatch.setattr(guard, "PATIENCE_S", 0.01)
        refused = client.get(f"{API}/campaigns")
        patient.may_go_on.set()
        assert {answer.result().status_code for answer in inside} == {200}
    assert refused.status_code == 429 and refused.headers["retry-after"] == "10"
    assert "expected a turn in time" in refused.json()["detail"]


def test_readers_of_the_archive_do_not_wait_for_a_flight(served, monkeypatch):
    patient, client = served
    # Reads of the list stand for a flight, which takes a minute where kernels are compiled.
    monkeypatch.setattr(guard, "FLIGHTS", frozenset({f"GET {API}/campaigns"}))
    with ThreadPoolExecutor(guard.READS + guard.HEAVY_READS) as readers:
        flights = [readers.submit(client.get, f"{API}/campaigns") for _ in range(3)]
        while not patient.n_inside:
            time.sleep(0.01)
        assert client.get(f"{API}/solutions/points").status_code == 200
        assert client.get(f"{API}/solutions").status_code == 200
        assert patient.most_inside == guard.FLOWN_READS and not any(flight.done() for flight in flights)
        patient.may_go_on.set()
        assert {flight.result().status_code for flight in flights} == {200}
