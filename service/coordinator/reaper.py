"""Takes back, again and again, the jobs whose workers have fallen silent; and forgets what is old."""

import logging
import threading
import time
from collections.abc import Callable

from service.db.engine import Unavailable
from service.store import Store

log = logging.getLogger(__name__)


class Reaper:
    """Looks for expired leases every `reap_s`, for the first time when a whole lease has passed.

    Workers that outlived the coordinator before this one have that long to renew theirs.
    """

    def __init__(
        self, store: Store, stop: threading.Event, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._store = store
        self._stop = stop
        self._clock = clock
        self._next = clock() + store.leases.lease_s

    def run(self) -> None:
        """Reap until told to stop."""
        while not self._stop.wait(max(0.0, self._next - self._clock())):
            self.step()

    def step(self) -> int:
        """Reap if it is time; return how many jobs went back."""
        if self._clock() < self._next:
            return 0
        self._next = self._clock() + self._store.leases.reap_s
        try:
            n_lost = self._store.reap()
            self._store.prune()
        except Unavailable as error:
            self._store.outage.tell(error)
            return 0
        except Exception:
            # Whatever it is, nobody would take jobs back any more if it ended this thread.
            log.exception("reaping failed")
            return 0
        if n_lost:
            log.warning("%d jobs lost their workers and go back", n_lost)
        return n_lost
