"""Heartbeats on a thread of their own: a solve in the dispatcher's thread must never delay them."""

import logging
import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Self

from workers.backoff import Backoff
from workers.executor import Ticket
from workers.job import MOST_HELD, HeartbeatAnswer, HeartbeatRequest, HeldJob, WorkerInfo
from workers.source import JobSource, Unreachable

log = logging.getLogger(__name__)

#: How soon after its start a worker is heard of, before it knows how often it has to be [s].
FIRST_PERIOD_S = 0.25


class Heartbeat:
    """Says again and again what is held, and collects the answers."""

    def __init__(
        self, source: JobSource, info: Callable[[], WorkerInfo], held: Callable[[], Sequence[Ticket]]
    ) -> None:
        #: As the source wants it [s].
        self.period_s = FIRST_PERIOD_S
        self._source = source
        self._info = info
        self._held = held
        self._answers: queue.SimpleQueue[HeartbeatAnswer] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="heartbeat", daemon=True)
        self._fault: Exception | None = None

    def __enter__(self) -> Self:
        """Begin."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Fall silent; a beat that waits for its answer is left behind."""
        self._stop.set()

    def answers(self) -> Iterator[HeartbeatAnswer]:
        """Return the answers that have arrived; raise what ended the thread, if something did."""
        if self._fault is not None:
            raise self._fault
        while not self._answers.empty():
            yield self._answers.get()

    def beat(self) -> None:
        """Say once what is held."""
        held = [HeldJob(job_id=ticket.job_id, attempt=ticket.attempt) for ticket in self._held()]
        for first in range(0, max(1, len(held)), MOST_HELD):
            request = HeartbeatRequest(worker=self._info(), held=tuple(held[first : first + MOST_HELD]))
            self._answers.put(self._source.heartbeat(request))

    def _run(self) -> None:
        backoff = Backoff()
        pause_s = self.period_s
        while not self._stop.wait(pause_s):
            try:
                self.beat()
                backoff.succeeded()
                pause_s = self.period_s
            except Unreachable as error:
                log.warning("heartbeat: %s", error)
                pause_s = min(backoff.failed(error.wait_s), self.period_s)
            except Exception as fault:
                self._fault = fault
                return
