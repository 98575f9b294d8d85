import csv
import io
import json
import threading
import time

import httpx
import pytest

from service.api import events
from service.api.solutions import csv_lines
from service.coordinator import Coordinator
from service.schemas.solution import Filter
from service.store.store import Store
from tests.service.by_hand import work_off
from tests.service.campaigns import spec_fields, submitted

API = "/api/v1"


@pytest.fixture
def finished(store):
    submitted(store, spec_fields(guesses=30))
    work_off(store)
    return store


def lines(answer):
    return [json.loads(line) for line in answer.text.splitlines()]


def test_ndjson_has_every_solution_once_with_every_field_and_its_vector(client, finished):
    answer = client.get(f"{API}/solutions", params={"format": "ndjson"})
    assert answer.headers["content-type"].startswith("application/x-ndjson")
    assert 'filename="solutions.ndjson"' in answer.headers["content-disposition"]
    found = lines(answer)
    assert len(found) == finished.campaign(1).n_solutions > 4
    assert [record["id"] for record in found] == sorted({record["id"] for record in found})
    whole = client.get(f"{API}/solutions/{found[0]['id']}").json()
    # Whether it was certified since is asked for one by one.
    assert whole.pop("certificate_hash") is None and found[0] == whole


def test_csv_has_the_same_solutions_in_columns(client, finished):
    answer = client.get(f"{API}/solutions", params={"format": "csv"})
    assert answer.headers["content-type"].startswith("text/csv")
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    records = lines(client.get(f"{API}/solutions", params={"format": "ndjson"}))
    assert [row["id"] for row in rows] == [record["id"] for record in records]
    assert all(
        float(row["delta_v_km_s"]) == record["delta_v_km_s"]
        for row, record in zip(rows, records, strict=True)
    )
    assert {row["outages"] for row in rows} == {"", "24:1.0"}


@pytest.mark.parametrize("sign", ["=", "+", "-", "@", "\t", "\r"])
def test_no_cell_is_a_formula_to_a_spreadsheet(finished, sign):
    record = next(finished.record_pages(Filter()))[0]
    changed = record.model_copy(update={"host": f"{sign}HYPERLINK(1)", "objective_kg": -1.5})
    _, line = csv.DictReader(io.StringIO("".join(csv_lines([[record, changed]])), newline=""))
    assert line["host"] == f"'{sign}HYPERLINK(1)" and line["objective_kg"] == "-1.5"


def test_filters_hold_for_downloads_as_for_pages(client, finished):
    def ids(**wanted):
        return {
            record["id"]
            for record in lines(client.get(f"{API}/solutions", params=wanted | {"format": "ndjson"}))
        }

    def listed(**wanted):
        page = client.get(f"{API}/solutions", params=wanted | {"limit": 200}).json()
        return {record["id"] for record in page["items"]}

    for wanted in ({"search": "s0"}, {"strict": True}, {"strict": False, "campaign": 1}, {"campaign": 2}):
        assert ids(**wanted) == listed(**wanted)
    assert ids(search="s0") | ids(search="s1-0") == ids() and ids(search="s0")


def test_an_empty_download_is_empty_and_not_refused(client):
    assert client.get(f"{API}/solutions", params={"format": "ndjson"}).text == ""
    assert client.get(f"{API}/solutions", params={"format": "csv"}).text.startswith("id,campaign_id,")


@pytest.mark.parametrize("more", [{"limit": 3}, {"after": "x"}])
def test_a_download_with_a_page_is_refused(client, more):
    answer = client.get(f"{API}/solutions", params={"format": "csv"} | more)
    assert answer.status_code == 422 and "neither limit nor after" in answer.json()["detail"]


@pytest.mark.parametrize("size", [1, 3, 1000])
def test_pages_of_any_size_join_to_the_whole(finished, size):
    found = [record.id for page in finished.record_pages(Filter(), size) for record in page]
    assert found == sorted(record.id for record in finished.all_records(Filter()))


class Once:
    """Lets a stream look for events so many times, then ends it."""

    def __init__(self, n=1):
        self.n = n

    def __call__(self):
        self.n -= 1
        return self.n < 0


def data(answer):
    return [json.loads(line[6:]) for line in answer.text.splitlines() if line.startswith("data: ")]


def test_streams_and_downloads_come_the_same_through_a_real_server(tmp_path):
    with Store(tmp_path) as store:
        submitted(store, spec_fields(guesses=30))
        work_off(store)
        expected = [event.id for event in store.events(7, 1, 100)]
    with Coordinator(tmp_path) as coordinator, httpx.Client(base_url=coordinator.url + API) as web:
        with web.stream("GET", "/campaigns/1/events", headers={"Last-Event-ID": "7"}) as answer:
            ids = (int(line[4:]) for line in answer.iter_lines() if line.startswith("id: "))
            assert [next(ids) for _ in expected] == expected
        first = web.get("/solutions", params={"limit": 3}).json()
        rest = web.get("/solutions", params={"limit": 200, "after": first["next"]}).json()
        paged = [record["id"] for record in (*first["items"], *rest["items"])]
        by_line = [record["id"] for record in lines(web.get("/solutions", params={"format": "ndjson"}))]
        table = csv.DictReader(io.StringIO(web.get("/solutions", params={"format": "csv"}).text, newline=""))
        assert len(set(paged)) == len(paged) and sorted(paged) == by_line == [row["id"] for row in table]
        key = {"Idempotency-Key": "once"}
        for guesses, status in ((30, 200), (30, 200), (31, 409)):
            again = web.post("/campaigns", json=spec_fields(guesses=guesses), headers=key)
            assert again.status_code == status
        assert again.json()["code"] == "key_reused"


def test_a_backlog_comes_without_a_pause_between_its_pages(client, finished, monkeypatch):
    monkeypatch.setattr(events, "PAGE", 5)
    monkeypatch.setattr(events, "POLL_S", 60.0)
    client.app.state.is_closing = Once(3)
    found = data(client.get(f"{API}/campaigns/1/events", headers={"Last-Event-ID": "2"}))
    assert [event["id"] for event in found] == list(range(3, 18))


def test_a_place_from_before_a_restored_backup_does_not_silence_the_stream(client, finished, monkeypatch):
    monkeypatch.setattr(events, "POLL_S", 0.0)
    client.app.state.is_closing = Once(2)
    seen = []
    monkeypatch.setattr(finished, "events", lambda *arguments: seen.append(arguments[0]) or [])
    client.get(f"{API}/campaigns/1/events", headers={"Last-Event-ID": "999999"})
    assert set(seen) == {finished.last_event_id(1)}


def test_a_stream_ends_by_itself_after_its_lifetime(client, finished, monkeypatch):
    monkeypatch.setattr(events, "LIFETIME_S", 0.0)
    answer = client.get(f"{API}/campaigns/1/events")
    assert answer.status_code == 200 and data(answer) == []
    assert f"retry: {events.RETRY_MS}" in answer.text


def test_a_server_stops_within_five_seconds_with_streams_open(tmp_path):
    with Store(tmp_path) as store:
        submitted(store)
    opened, ended = threading.Barrier(4, timeout=60), []

    def follow(url):
        with httpx.stream("GET", f"{url}{API}/campaigns/1/events", timeout=60) as answer:
            opened.wait()
            for _ in answer.iter_lines():
                pass
        ended.append(url)

    coordinator = Coordinator(tmp_path)
    with coordinator:
        threads = [threading.Thread(target=follow, args=(coordinator.url,), daemon=True) for _ in range(3)]
        for thread in threads:
            thread.start()
        opened.wait()
        begin = time.monotonic()
    assert time.monotonic() - begin < 5.0
    for thread in threads:
        thread.join(10)
    # Each saw the end of its stream, none a broken connection.
    assert len(ended) == 3
