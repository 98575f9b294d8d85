import pytest
from fastapi.testclient import TestClient
from prometheus_client.parser import text_string_to_metric_families

from service.app import create_app
from service.auth.network import Access
from service.schemas.identity import Role
from service.store.store import Store
from tests.service.by_hand import work_off, worker_info
from tests.service.campaigns import submitted
from tests.service.clock import Clock
from tests.service.databases import needs_postgres, rows

BOTH = pytest.mark.parametrize(
    "store",
    ["sqlite", pytest.param("postgresql", marks=[needs_postgres, pytest.mark.postgres])],
    indirect=True,
)


def scraped(client):
    """Return the samples of a scrape by (name, value of the label)."""
    text = client.get("/metrics").text
    return {
        (sample.name.removeprefix("coastarc_"), *sample.labels.values()): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_it_is_the_text_format_of_prometheus(client):
    assert client.get("/metrics").headers["content-type"].startswith("text/plain; version=0.0.4")
    assert client.get("/api/v1/metrics").status_code == 200


@BOTH
def test_the_numbers_are_those_of_the_tables(client, store):
    submitted(store)
    store.register(worker_info())
    store.claim("node7:1", 2)
    found = scraped(client)
    assert found["jobs", "queued"] == 2 and found["jobs", "running"] == 2 and found["jobs", "dead"] == 0
    assert found["campaigns", "active"] == 1 and found["attempts", "open"] == 2
    assert found["workers_alive",] == 1 and found["worker_slots",] == 8
    assert found["solves_total", "feasible"] == 0 and found["archive_bytes",] > 10_000


@BOTH
def test_solves_are_counted_and_timed_by_ending(client, store):
    submitted(store)
    before = scraped(client)
    work_off(store)
    found = scraped(client)
    for ending, number, seconds in rows(
        store, "SELECT ending, count(*), sum(cpu_seconds) FROM solve GROUP BY ending"
    ):
        assert found["solves_total", ending] == number > before["solves_total", ending]
        assert found["solve_cpu_seconds_total", ending] == pytest.approx(seconds, rel=1e-12)
    assert found["solutions",] == rows(store, "SELECT count(*) FROM solution")[0][0]
    for state, number in rows(store, "SELECT state, count(*) FROM job GROUP BY state"):
        assert found["jobs", state] == number
    for ending, number in rows(store, "SELECT ending, count(*) FROM attempt GROUP BY ending"):
        assert found["attempts", ending] == number


def test_the_oldest_lease_ages_until_its_heartbeat(tmp_path):
    clock = Clock()
    store = Store(tmp_path, clock=clock)
    submitted(store)
    assert store.gauges.read().oldest_lease_s == 0.0
    store.claim("node7:1", 1)
    clock.advance(12.0)
    store.claim("node8:1", 1)
    assert store.gauges.read().oldest_lease_s == pytest.approx(12.0)
    store.close()


def test_writes_and_refused_writes_are_counted(client, store):
    store.check()
    first = scraped(client)
    store.check()
    found = scraped(client)
    assert found["write_seconds_count",] == first["write_seconds_count",] + 1
    assert found["write_seconds_bucket", "+Inf"] == found["write_seconds_count",]
    assert found["write_faults_total",] == 0.0


def test_a_write_that_failed_by_our_own_doing_is_no_stored_one(store):
    def broken(moment):
        raise ZeroDivisionError

    store._database.hook = broken
    with pytest.raises(ZeroDivisionError):
        store.check()
    assert sum(store.gauges.write_times[0]) == 0


def test_a_viewer_may_scrape_and_nobody_else_without_a_token(store):
    token = store.identities.create("prometheus", Role.VIEWER, 1.0).token
    app = create_app(store, access=Access(is_open=False))
    with TestClient(app, base_url="http://127.0.0.1:8741") as stranger:
        assert stranger.get("/metrics").status_code == 401
        assert stranger.get("/metrics", headers={"Authorization": f"Bearer {token}"}).status_code == 200
