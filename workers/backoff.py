"""Time: when to try again what failed, and how much of it this process could work in."""

import random
import time
from collections.abc import Callable

#: Whoever looks at the clock again and again, and finds more than this gone, was stopped meanwhile [s].
LONGEST_GAP_S = 10.0


class Awake:
    """Seconds in which this process could work, for whoever asks often: a pause of it counts for little.

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
    """Waits that double with every failure in a row, each cut at random so that many do not come at once."""

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
        """Begin to wait, and return how long [s]."""
        wait_s = min(self._first_s * 2.0 ** min(self._n_failures, 30), self._longest_s)
        self._n_failures += 1
        # No result depends on it, so it may draw from the common generator.
        wait_s = max(wait_s * random.uniform(0.5, 1.0), at_least_s)
        self._due = self._clock() + wait_s
        return wait_s

    def succeeded(self) -> None:
        """Begin anew."""
        self._n_failures, self._due = 0, 0.0
