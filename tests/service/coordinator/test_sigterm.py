"""A coordinator that is asked to end does so, whoever follows its events."""

import http.client
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import closing, suppress
from pathlib import Path
from urllib.parse import urlsplit

import pytest

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


def read(place):
    connection = http.client.HTTPConnection(place.hostname, place.port, timeout=60)
    with closing(connection), suppress(OSError, http.client.HTTPException):
        while True:
            connection.request("GET", "/api/v1/campaigns")
            connection.getresponse().read()


@pytest.mark.slow
def test_it_ends_within_seconds_of_sigterm_with_all_streams_open(tmp_path):
    command = [
        str(Path(sys.executable).with_name("coastarc")),
        "serve",
        "--port",
        "0",
        "--data",
        str(tmp_path),
    ]
    process = subprocess.Popen([*command, "--workers", "1"], stdout=subprocess.PIPE, text=True)
    try:
        place = urlsplit(re.search(r"http://\S+", process.stdout.readline())[0])
        answers: list[int] = []
        threads = [threading.Thread(target=follow, args=(place, answers)) for _ in range(N_STREAMS)]
        threads += [threading.Thread(target=read, args=(place,)) for _ in range(N_READERS)]
        for thread in threads:
            thread.start()
        end = time.monotonic() + 60.0
        while len(answers) < N_STREAMS and time.monotonic() < end:
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        # Its own limit is 2 s for answers under way; the rest is Python's end on a busy machine.
        assert process.wait(15.0) == 0 and answers == [200] * N_STREAMS
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
        for thread in threads:
            thread.join()
