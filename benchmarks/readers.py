"""Readers beside the workers of `benchmarks.service`: each asks again as soon as it has its answer.

They run in a process of their own, as the simulated workers do.  A quarter of them asks for the metrics of
the busy campaign, the others for what pages and commands read.
"""

import http.client
import threading
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import cycle
from multiprocessing.synchronize import Event
from typing import Any
from urllib.parse import urlsplit

from benchmarks.probe import READS

METRICS = "/api/v1/campaigns/{campaign}/metrics"
#: One in so many asks for metrics alone.
EVERY_NTH = 4
#: After an answer that is none; who is told to wait waits this long [s].
PAUSE_S = 1.0


@dataclass(slots=True)
class ReadersTally:
    """What the readers met."""

    statuses: Counter[str] = field(default_factory=Counter)
    #: Times of answers by what was asked [s].
    reads: dict[str, list[float]] = field(default_factory=dict)


def run_readers(url: str, tokens: Sequence[str], campaign_id: int, stop: Event, results: Any) -> None:
    """Run a reader for each token until told to stop, and put their tally into a queue."""
    tally = ReadersTally()
    threads = [
        threading.Thread(target=_read, args=(url, token, number, campaign_id, tally, stop))
        for number, token in enumerate(tokens)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    results.put(tally)


def _read(url: str, token: str, number: int, campaign_id: int, tally: ReadersTally, stop: Event) -> None:
    place = urlsplit(url)
    connection = http.client.HTTPConnection(place.hostname or "", place.port, timeout=120)
    turns = cycle((METRICS,) if number % EVERY_NTH == 0 else READS[number % len(READS) :] + READS)
    for template in turns:
        if stop.is_set():
            break
        begin = time.perf_counter()
        try:
            address = template.format(campaign=campaign_id, event=0)
            connection.request("GET", address, headers={"Authorization": f"Bearer {token}"})
            answer = connection.getresponse()
            answer.read()
        except (OSError, http.client.HTTPException) as error:
            tally.statuses[type(error).__name__] += 1
            connection.close()
            stop.wait(PAUSE_S)
            continue
        tally.statuses[str(answer.status)] += 1
        if answer.status == http.client.OK:
            tally.reads.setdefault(template, []).append(time.perf_counter() - begin)
        else:
            stop.wait(PAUSE_S)
    connection.close()
