"""A coordinator that is asked to end does so, whoever follows its events."""

import http.client
import json
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import closing, suppress
from urllib.parse import urlsplit

import pytest

from service.store.store import Store
from tests.service.campaigns import spec_fields, submitted

#: As many as one client may have.
N_STREAMS, N_READERS = 16, 4


def follow(place, answers):
    connection = http.client.HTTPConnection(place.hostname, place.port, timeout=60)
    with closing(connection), suppress(OSError, http.client.HTTPException):
        connection.request("GET", "/api/v1/events/stream")
        answer = connection.getresponse()
        answers.append(answer.status)
        while answer.read(1):
            pass


def is_at_work(place):
    with closing(http.client.HTTPConnection(place.hostname, place.port, timeout=60)) as connection:
        connection.request("GET", "/api/v1/jobs?state=running")
        return len(json.loads(connection.getresponse().read())["items"]) == 2


def read(place):
    connection = http.client.HTTPConnection(place.hostname, place.port, timeout=60)
    with closing(connection), suppress(OSError, http.client.HTTPException):
        while True:
            connection.request("GET", "/api/v1/campaigns")
            connection.getresponse().read()


@pytest.mark.slow
@pytest.mark.parametrize("runner", ["run_until_stopped", "run_deaf"])
def test_it_ends_within_seconds_of_sigterm_with_all_streams_open_amid_solves(tmp_path, runner):
    with Store(tmp_path) as store:
        submitted(store, spec_fields(4))
    command = [sys.executable, "-m", "tests.service.fake_coastarc", runner, "serve", "--port", "0"]
    command += ["--data", str(tmp_path), "--workers", "2"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    threads: list[threading.Thread] = []
    try:
        place = urlsplit(re.search(r"http://\S+", process.stdout.readline())[0])
        answers: list[int] = []
        threads += [threading.Thread(target=follow, args=(place, answers)) for _ in range(N_STREAMS)]
        threads += [threading.Thread(target=read, args=(place,)) for _ in range(N_READERS)]
        for thread in threads:
            thread.start()
        end = time.monotonic() + 60.0
        while not (len(answers) == N_STREAMS and is_at_work(place)) and time.monotonic() < end:
            time.sleep(0.05)
        assert is_at_work(place)
        process.send_signal(signal.SIGTERM)
        time.sleep(0.5)
        # Whoever is impatient breaks nothing.
        process.send_signal(signal.SIGTERM)
        # A machine with ten processes in line for two processors needs 3 to 5 s.
        assert process.wait(10.0) in (0, 130) and answers == [200] * N_STREAMS
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
        for thread in threads:
            thread.join()
