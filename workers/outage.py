"""What cannot be used for a while, in few lines of the log: when that begins, each minute, and at its end."""

import logging
import threading
import time
from collections.abc import Callable

log = logging.getLogger(__name__)

#: How often it is said that something can still not be used [s].
PERIOD_S = 60.0


class Outage:
    """What is said of the faults of one thing, which may come a thousand times a minute; any thread may."""

    def __init__(self, thing: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._thing = thing
        self._clock = clock
        self._lock = threading.Lock()
        self._began: float | None = None
        self._next = 0.0
        self._n_faults = 0

    def tell(self, fault: object) -> None:
        """Say what is wrong, unless something was said within the last minute."""
        with self._lock:
            now = self._clock()
            if self._began is None:
                self._began, self._next = now, now
            self._n_faults += 1
            if now < self._next:
                return
            self._next = now + PERIOD_S
        log.error("%s", fault)

    def end(self) -> None:
        """Say that it works again, if it was said that it does not."""
        if self._began is None:
            return
        with self._lock:
            began, n_faults, self._began, self._n_faults = self._began, self._n_faults, None, 0
        if began is not None:
            lasted_s = self._clock() - began
            log.warning(
                "%s: works again after %.0f s, in which %d calls failed", self._thing, lasted_s, n_faults
            )
