"""The file of a campaign over HTTP: the same bytes as by command, and nothing kept of one that is refused."""

import tracemalloc

import anyio
import pytest
from fastapi.testclient import TestClient

from service.api import campaigns
from service.app import create_app
from service.auth import network, request_limits
from service.auth.request_limits import save_body
from service.errors import BodyError
from tests.acceptance import known
from tests.service.archive_format.made import everything
from tests.service.archive_format.test_refused import FORGERIES, forged

IMPORT = "/api/v1/campaigns/import"
URL = "http://127.0.0.1:8741"


def send(client, content):
    return client.post(IMPORT, content=content, headers={"content-type": "application/zip"})


def names(folder):
    return sorted(str(path) for path in folder.rglob("*"))


# Taking away and taking in.


def test_a_campaign_goes_from_one_service_to_another_and_back(origin, client):
    with TestClient(create_app(origin), base_url=URL) as there:
        away = there.get("/api/v1/campaigns/2/export")
        assert away.status_code == 200 and "content-encoding" not in away.headers
    answer = send(client, away.content)
    assert answer.status_code == 201 and answer.headers["location"] == "/api/v1/campaigns/2"
    assert answer.json()["new_campaigns"] == ["known solutions", "later"]
    assert client.get("/api/v1/campaigns/2/export").content == away.content


def test_a_second_time_nothing_is_new(files, client, store):
    assert send(client, files[0].read_bytes()).status_code == 201
    before = everything(store)
    answer = send(client, files[0].read_bytes())
    told = {"campaign_id": 1, "new_campaigns": [], "n_solves": 0, "n_solutions": 0, "n_certificates": 0}
    assert answer.status_code == 200 and answer.json() == told
    assert everything(store) == before


# Refusals.


def test_nothing_is_kept_of_a_file_that_is_damaged_or_something_else(files, client, store):
    whole = files[0].read_bytes()
    before, kept = everything(store), names(store.folder)
    damaged = bytearray(whole)
    damaged[len(whole) // 2] ^= 0x41
    for content in (b"", b"{}", b"campaign", whole[:-1000], bytes(damaged)):
        answer = send(client, content)
        assert answer.status_code == 422, content[:20]
        assert answer.headers["content-type"] == "application/problem+json"
        assert answer.json()["detail"].startswith("file that was sent: expected ")
        assert str(store.folder) not in answer.text
    assert everything(store) == before and names(store.folder) == kept


@pytest.mark.parametrize(("name", "change", "reason"), FORGERIES[::6])
def test_what_somebody_has_written_into_it_is_refused(files, client, store, tmp_path, name, change, reason):
    before = everything(store)
    answer = send(client, forged(files[0], tmp_path / "forged.zip", change, name).read_bytes())
    assert answer.status_code == 422 and "expected" in answer.json()["detail"]
    assert everything(store) == before


def test_the_same_campaign_with_other_work_stands_against_it(files, client, store):
    known.submitted(store)
    store.control_campaign(1, "cancel")
    answer = send(client, files[0].read_bytes())
    assert answer.status_code == 409 and answer.json()["code"] == "wrong_state"


@pytest.mark.parametrize("is_declared", [True, False])
def test_a_file_that_is_too_large_is_refused(client, store, monkeypatch, is_declared):
    monkeypatch.setattr(network if is_declared else campaigns, "MAX_PORTABLE_BYTES", 1000)
    kept = names(store.folder)
    answer = send(client, 600 * b"ab" if is_declared else iter([600 * b"a", 600 * b"b"]))
    assert answer.status_code == 413 and "body: expected at most 1000 bytes, got" in answer.json()["detail"]
    assert names(store.folder) == kept


# The body on its way.


def received(messages):
    """Return a `receive` that gives some messages and is silent then."""
    left = iter(messages)

    async def receive():
        for message in left:
            return message
        await anyio.sleep_forever()

    return receive


def piece(content, more_body=True):
    return {"type": "http.request", "body": content, "more_body": more_body}


def test_a_body_of_any_size_takes_no_more_memory_than_a_few_pieces(tmp_path):
    one = bytes(2**20)
    messages = (piece(one, more_body=n < 99) for n in range(100))
    tracemalloc.start()
    with open(tmp_path / "body", "wb") as file:
        anyio.run(save_body, received(messages), 2**30, file)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert (tmp_path / "body").stat().st_size == 100 * 2**20 and most < 5 * 2**20


@pytest.mark.parametrize("messages", [[], [piece(b"PK")], [piece(b"PK"), {"type": "http.disconnect"}]])
def test_a_body_that_stops_on_the_way_is_refused(tmp_path, monkeypatch, messages):
    monkeypatch.setattr(request_limits, "PATIENCE_S", 0.01)
    with open(tmp_path / "body", "wb") as file, pytest.raises(BodyError, match="its next piece") as raised:
        anyio.run(save_body, received(messages), 2**30, file)
    assert raised.value.status == 408


def test_a_disk_without_room_is_no_fault_of_ours():
    with open("/dev/full", "wb", buffering=0) as file, pytest.raises(BodyError, match="No space") as raised:
        anyio.run(save_body, received([piece(b"PK")]), 2**30, file)
    assert raised.value.status == 503


def test_a_client_sends_one_file_at_a_time(store):
    app = create_app(store)
    answers = []

    async def ask(receive):
        scope = {"type": "http", "method": "POST", "path": IMPORT, "query_string": b"", "root_path": ""}
        scope |= {"scheme": "http", "headers": [(b"host", b"127.0.0.1")], "client": ("127.0.0.1", 1)}

        async def keep(message):
            if message["type"] == "http.response.start":
                answers.append(message["status"])

        await app(scope, receive, keep)

    async def both():
        begun, is_over = anyio.Event(), anyio.Event()

        async def slow():
            begun.set()
            await is_over.wait()
            return {"type": "http.disconnect"}

        async with anyio.create_task_group() as tasks:
            tasks.start_soon(ask, slow)
            await begun.wait()
            await ask(received([piece(b"PK", more_body=False)]))
            is_over.set()
        await ask(received([piece(b"PK", more_body=False)]))

    anyio.run(both)
    assert answers == [429, 408, 422]
