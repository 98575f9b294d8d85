"""Many requests that keep a processor busy: nobody else waits for them."""

import threading
import time

import httpx
import pytest

from service.auth.network import Access
from service.auth.request_limits import N_RUNNING, N_WAITING
from service.coordinator import WebServer, open_port
from tests.service.campaigns import SPIRAL, spec_fields
from tests.workers.jobs import worker_info
from workers.messages import ClaimRequest

#: Thousands of revolutions, which take a minute.
SLOW = {"preset": "ppe-drm3", "spacecraft": {"max_thrust_n": 0.01}}
SLOW["departure"] = SPIRAL | {"apogee_radius_km": 6578.0, "duration_days": 999.0}
N_REQUESTS = 45
CLAIM = ClaimRequest(worker=worker_info("test", slots=1), n_jobs=1).model_dump(mode="json")


@pytest.fixture
def url(store):
    with open_port("127.0.0.1", 0) as listener:
        server = WebServer(store, listener, "127.0.0.1", Access())
        server.start()
        yield server.url
        server.stop()


def asked(url, path, body):
    return httpx.post(f"{url}/api/v1{path}", json=body, timeout=120)


@pytest.mark.slow
def test_forty_five_slow_submissions_keep_nobody_from_an_answer(url, monkeypatch):
    monkeypatch.setattr("service.spec.spec_check.MOST_CPU_S", 1.0)
    answers, waits = [], []
    bodies = [SLOW | {"n_segments": 50 + n} for n in range(N_REQUESTS)]
    threads = [
        threading.Thread(target=lambda body=body: answers.append(asked(url, "/problems", body)))
        for body in bodies
    ]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        begun = time.monotonic()
        assert httpx.get(f"{url}/healthz", timeout=60).status_code == 200
        assert asked(url, "/jobs/claim", CLAIM).status_code == 200
        waits.append(time.monotonic() - begun)
        time.sleep(0.05)
    statuses = [answer.status_code for answer in answers]
    # Who finds no room asks again; who has it is told what takes too long.
    assert statuses.count(503) + statuses.count(422) == N_REQUESTS
    assert statuses.count(422) >= N_RUNNING + N_WAITING - 1 and statuses.count(503) > 0
    assert all(answer.headers["retry-after"] == "10" for answer in answers if answer.status_code == 503)
    # Ten seconds of processor time were ahead of everybody before.
    assert max(waits) < 5.0
    assert asked(url, "/campaigns", spec_fields()).status_code == 201
