"""Heartbeats, sent from their own thread: a solve in the dispatcher's thread must not delay them."""

import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Self

from workers.messages import (
    MOST_HELD,
    HeartbeatAnswer,
    HeartbeatRequest,
    HeldJob,
    JobSource,
    Ticket,
    UnreachableError,
    WorkerInfo,
)
from workers.retry import Backoff, Downtime

#: How soon after its start a worker is heard of, before it knows how often it has to be [s].
FIRST_PERIOD_S = 0.25
#: How often it is asked in between what to cancel, which writes nothing [s].
LOOK_S = 0.5


class Heartbeat:
    """Periodically reports the held jobs and collects the answers."""

    def __init__(
        self,
        source: JobSource,
        info: Callable[[], WorkerInfo],
        held: Callable[[], Sequence[Ticket]],
        downtime: Downtime,
    ) -> None:
        #: As the source wants it [s].
        self.period_s = FIRST_PERIOD_S
        self._source = source
        self._info = info
        self._held = held
        self._downtime = downtime
        self._answers: queue.SimpleQueue[HeartbeatAnswer] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="heartbeat", daemon=True)
        self._fault: Exception | None = None

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop; do not wait for an in-flight request."""
        self._stop.set()

    def answers(self) -> Iterator[HeartbeatAnswer]:
        """Return the answers that have arrived; raise what ended the thread, if something did."""
        if self._fault is not None:
            raise self._fault
        while not self._answers.empty():
            yield self._answers.get()

    def beat(self, extend: bool = True) -> None:
        """Send one heartbeat, to extend the leases or only to learn what to cancel."""
        held = [HeldJob(**ticket._asdict()) for ticket in self._held()]
        for first in range(0, max(1, len(held)), MOST_HELD):
            part = tuple(held[first : first + MOST_HELD])
            request = HeartbeatRequest(worker=self._info(), held=part, extend=extend)
            self._answers.put(self._source.heartbeat(request))

    def look(self) -> None:
        """Ask what to cancel, if anything is held."""
        if self._held():
            self.beat(extend=False)

    def _run(self) -> None:
        backoff, pause_s = Backoff(), self.period_s
        next_beat = time.monotonic() + pause_s
        while not self._stop.wait(pause_s):
            try:
                if time.monotonic() < next_beat:
                    self.look()
                else:
                    self.beat()
                    next_beat = time.monotonic() + self.period_s
                backoff.succeeded()
                pause_s = min(LOOK_S, max(0.0, next_beat - time.monotonic()))
            except UnreachableError as error:
                self._downtime.tell(f"heartbeat: {error}")
                pause_s = min(backoff.failed(error.wait_s), self.period_s)
            except Exception as fault:
                self._fault = fault
                return
