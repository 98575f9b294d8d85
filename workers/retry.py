"""Retrying what is unavailable: backoff, a clock that ignores pauses of the process, log of the downtime."""

import logging
import random
import threading
import time
from collections.abc import Callable

log = logging.getLogger(__name__)

#: A longer gap between two readings means that the process was stopped [s].
LONGEST_GAP_S = 10.0


class Awake:
    """A clock that counts the seconds in which this process could run; it has to be read often.

    Batch systems stop processes, virtual machines and laptops stand still; the monotonic clock goes on in
    some of these, and what is limited in time would be over when it is woken up.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._seen = clock()
        self._seconds = 0.0

    def __call__(self) -> float:
        """Return the seconds since this was made, without pauses."""
        now = self._clock()
        self._seconds += min(now - self._seen, LONGEST_GAP_S)
        self._seen = now
        return self._seconds


class Backoff:
    """Exponential backoff with jitter."""

    def __init__(
        self, first_s: float = 0.2, longest_s: float = 5.0, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._first_s = first_s
        self._longest_s = longest_s
        self._clock = clock
        self._n_failures = 0
        self._due = 0.0

    def is_due(self) -> bool:
        """Return whether the wait after the last failure is over."""
        return self._clock() >= self._due

    def failed(self, at_least_s: float = 0.0) -> float:
        """Count a failure, and return the wait [s]."""
        wait_s = min(self._first_s * 2.0 ** min(self._n_failures, 30), self._longest_s)
        self._n_failures += 1
        # No result depends on it, so it may draw from the common generator.
        wait_s = max(wait_s * random.uniform(0.5, 1.0), at_least_s)
        self._due = self._clock() + wait_s
        return wait_s

    def succeeded(self) -> None:
        """Reset."""
        self._n_failures, self._due = 0, 0.0


#: How often it is said that something can still not be used [s].
PERIOD_S = 60.0


class Downtime:
    """Logs the downtime of one thing, at most once a minute; thread-safe."""

    def __init__(self, thing: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._thing = thing
        self._clock = clock
        self._lock = threading.Lock()
        self._began: float | None = None
        self._next = 0.0
        self._n_faults = 0

    def tell(self, fault: object) -> None:
        """Log a fault, unless one was logged within the last minute."""
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
        """Log that it works again, if a fault was logged."""
        if self._began is None:
            return
        with self._lock:
            began, n_faults, self._began, self._n_faults = self._began, self._n_faults, None, 0
        if began is not None:
            lasted_s = self._clock() - began
            log.warning(
                "%s: works again after %.0f s, in which %d calls failed", self._thing, lasted_s, n_faults
            )
