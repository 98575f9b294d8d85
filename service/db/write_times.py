"""How long writes take: counted here, read by /metrics."""

import threading
from bisect import bisect_left

#: Upper ends of the classes in which writes are counted [s].
CLASSES_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0)


class WriteTimes:
    """A histogram of the writes of one process; a write's time begins when it asks for its turn."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts = [0] * (len(CLASSES_S) + 1)
        self._seconds = 0.0
        self._n_faults = 0

    def add(self, seconds: float) -> None:
        """Count a write that was stored."""
        with self._lock:
            self._counts[bisect_left(CLASSES_S, seconds)] += 1
            self._seconds += seconds

    def add_fault(self) -> None:
        """Count a write that the place did not take."""
        with self._lock:
            self._n_faults += 1

    def read(self) -> tuple[list[int], float, int]:
        """Return the writes per class, those above the last one at the end; their seconds; the faults."""
        with self._lock:
            return list(self._counts), self._seconds, self._n_faults
