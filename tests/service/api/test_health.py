import json

import pytest

from service.api import health
from service.db.engine import Moment
from service.db.errors import DatabaseError
from service.store.store import Store
from tests.service.by_hand import worker_info
from tests.service.clock import Clock
from tests.service.databases import needs_postgres, rows

BOTH = pytest.mark.parametrize(
    "store",
    ["sqlite", pytest.param("postgresql", marks=[needs_postgres, pytest.mark.postgres])],
    indirect=True,
)


@pytest.fixture(autouse=True)
def always_asked_anew(monkeypatch):
    monkeypatch.setattr(health, "KEPT_S", 0.0)


def test_a_process_that_answers_is_alive(client):
    assert client.get("/healthz").json() == {"status": "ok", "checks": {}}


@BOTH
def test_a_service_with_archive_dispatcher_and_kernels_is_ready(client, store):
    store.register(worker_info())
    answer = client.get("/readyz")
    assert answer.status_code == 200 and answer.json() == health.READY
    assert client.get("/api/v1/readyz").json() == health.READY


def test_without_a_dispatcher_it_is_not_ready_and_says_what_to_do(client):
    answer = client.get("/readyz")
    assert answer.status_code == 503 and answer.headers["content-type"] == "application/problem+json"
    assert answer.json() == health.UNREADY


def test_a_dispatcher_that_fell_silent_does_not_count(tmp_path):
    clock = Clock()
    store = Store(tmp_path, clock=clock)
    store.register(worker_info())
    assert store.gauges.n_workers() == 1
    clock.advance(31.0)
    assert store.gauges.n_workers() == 0
    store.close()


def test_an_archive_that_takes_no_write_is_not_ready_and_keeps_its_place_to_itself(client, store):
    def full(moment):
        if moment is Moment.BEFORE_COMMIT:
            raise DatabaseError(f"{store.folder}: disk full")

    store.register(worker_info())
    store._database.hook = full
    answer = client.get("/readyz")
    assert answer.status_code == 503 and "archive" in answer.json()["detail"]
    assert str(store.folder) not in answer.text and answer.json()["checks"]["dispatcher"] == "ok"


def test_an_archive_of_another_schema_is_not_ready(client, store):
    store._database.write(
        lambda session: session.connection().exec_driver_sql(
            "UPDATE alembic_version SET version_num = '0001'"
        )
    )
    assert client.get("/readyz").json()["checks"]["archive"] != "ok"
    assert rows(store, "SELECT version_num FROM alembic_version") == [("0001",)]


def test_missing_kernels_are_named(client, store, monkeypatch, tmp_path):
    monkeypatch.setattr(health, "kernel_paths", lambda: (tmp_path / "de440.bsp",))
    assert "de440.bsp" in client.get("/readyz").json()["checks"]["kernels"]


def test_many_who_ask_cause_one_write(client, store, monkeypatch):
    monkeypatch.setattr(health, "KEPT_S", 60.0)
    first = [client.get("/readyz").json() for _ in range(5)]
    assert all(answer == first[0] for answer in first)
    assert sum(store.gauges.write_times[0]) == 1


def test_the_examples_of_the_document_are_what_is_sent(client):
    responses = client.get("/api/v1/openapi.json").json()["paths"]["/readyz"]["get"]["responses"]
    example = responses["503"]["content"]["application/problem+json"]["example"]
    assert json.loads(client.get("/readyz").text) == example
