"""Connections on which nothing is asked: they are closed, and keep nobody out."""

import io
import logging
import socket
import time
from contextlib import ExitStack

import httpx
import pytest

from service import logs
from service.auth.network import Access
from service.coordinator import WebServer, connections, open_port
from tests.service.campaigns import submitted
from tests.workers.jobs import worker_info
from workers.messages import ClaimRequest

CLAIM = ClaimRequest(worker=worker_info("test", slots=1), n_jobs=1).model_dump(mode="json")


@pytest.fixture
def serve(store):
    """Start a web server when it is asked for, with the limits of that moment."""
    with ExitStack() as opened:

        def start():
            server = WebServer(store, opened.enter_context(open_port("127.0.0.1", 0)), "127.0.0.1", Access())
            server.start()
            opened.callback(server.stop)
            return server.url

        yield start


@pytest.fixture
def sockets():
    """Open sockets to a server, each of which has sent something."""
    with ExitStack() as opened:

        def opens(url, n, sent=b""):
            made = []
            for _ in range(n):
                one = socket.create_connection(("127.0.0.1", int(url.rpartition(":")[2])), timeout=30)
                opened.callback(one.close)
                one.sendall(sent)
                made.append(one)
            return made

        yield opens


def seconds_of_health_and_claim(url):
    begun = time.monotonic()
    assert httpx.get(f"{url}/healthz", timeout=30).status_code == 200
    assert httpx.post(f"{url}/api/v1/jobs/claim", json=CLAIM, timeout=30).status_code == 200
    return time.monotonic() - begun


def is_closed(one, seconds):
    """Return whether the other side closes a connection within a time."""
    one.settimeout(seconds)
    try:
        while one.recv(65536):
            pass
    except TimeoutError:
        return False
    except ConnectionResetError:
        return True
    return True


@pytest.fixture
def log():
    """What is logged."""
    root, stream = logging.getLogger(), io.StringIO()
    before = root.handlers[:], root.level
    logs.configure(stream)
    yield stream
    root.handlers[:], root.level = before


def test_twelve_hundred_idle_connections_keep_nobody_out_and_write_nothing(serve, sockets, log, monkeypatch):
    monkeypatch.setattr(connections, "HEAD_PATIENCE_S", 4.0)
    url = serve()
    idle = sockets(url, 1200)
    assert seconds_of_health_and_claim(url) < 5.0
    assert all(is_closed(one, 30.0) for one in idle)
    assert len(log.getvalue()) < 10_000


def test_where_files_are_few_a_new_connection_takes_the_place_of_one_that_waits(serve, sockets, monkeypatch):
    monkeypatch.setattr("service.coordinator.coordinator.most_connections", lambda: 50)
    url = serve()
    idle = sockets(url, 300)
    assert seconds_of_health_and_claim(url) < 5.0
    # The oldest gave way first.
    assert all(is_closed(one, 5.0) for one in idle[:200])


@pytest.mark.parametrize(
    "sent",
    [
        b"",
        b"GET /healthz HT",
        b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: 1\r\n",
        # A body that nobody waits for.
        b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000\r\n\r\n",
    ],
)
def test_who_does_not_end_what_was_begun_is_cut_off_however_often_more_comes(
    serve, sockets, monkeypatch, sent
):
    monkeypatch.setattr(connections, "HEAD_PATIENCE_S", 1.0)
    (one,) = sockets(serve(), 1, sent)
    begun = time.monotonic()
    while time.monotonic() - begun < 10.0:
        if is_closed(one, 0.2):
            break
        try:
            one.sendall(b"a" if sent else b"")
        except OSError:
            break
    assert 0.5 < time.monotonic() - begun < 8.0


def test_a_slow_body_and_a_stream_of_events_go_on(serve, sockets, store, monkeypatch):
    monkeypatch.setattr(connections, "HEAD_PATIENCE_S", 0.5)
    campaign = submitted(store)
    url = serve()
    head = b"Host: 127.0.0.1\r\nContent-Type: application/json\r\nContent-Length: 2\r\n\r\n"
    (slow,) = sockets(url, 1, b"POST /api/v1/problems HTTP/1.1\r\n" + head)
    with httpx.stream("GET", f"{url}/api/v1/campaigns/{campaign}/events?after=0", timeout=30) as events:
        lines = events.iter_lines()
        assert next(lines)
        time.sleep(1.5)
        store.control_campaign(campaign, "pause")
        assert any("paused" in line for line in lines)
    slow.sendall(b"{}")
    assert slow.recv(65536).startswith(b"HTTP/1.1 422 ")


def test_a_coordinator_asks_for_the_files_that_it_may_have():
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (512, before[1]))
        assert connections.raise_file_limit() == resource.getrlimit(resource.RLIMIT_NOFILE)[0] > 512
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
