"""What a dispatcher and all processes below it need, told to people and never part of a result."""

import threading
import time
from typing import TypedDict

import psutil

#: Claims may come many times a second; whoever looks wants a mean over some seconds [s].
KEPT_S = 3.0


class Need(TypedDict):
    """The fields of `workers.job.WorkerInfo` that are measured."""

    cpu_cores: float
    memory_bytes: int
    host_memory_bytes: int


class Usage:
    """Processors kept busy since the last look, and memory now, of this process and its descendants."""

    def __init__(self, kept_s: float = KEPT_S) -> None:
        self._kept_s = kept_s
        self._lock = threading.Lock()
        self._own = psutil.Process()
        self._seconds, _ = self._look()
        self._at = time.monotonic()
        self._last: Need | None = None

    def read(self) -> Need | None:
        """Return what was needed in the last seconds, or None before a first few are over."""
        with self._lock:
            passed = time.monotonic() - self._at
            if passed >= self._kept_s:
                self._last = self._measured(passed)
            return self._last

    def _measured(self, passed: float) -> Need:
        seconds, memory = self._look()
        # Of a process that has ended since, the last moments are not known; one that is new began at zero.
        spent = sum(now - self._seconds.get(process, 0.0) for process, now in seconds.items())
        self._seconds, self._at = seconds, time.monotonic()
        total = psutil.virtual_memory().total
        return Need(
            cpu_cores=max(0.0, round(spent / passed, 3)), memory_bytes=memory, host_memory_bytes=total
        )

    def _look(self) -> tuple[dict[tuple[int, float], float], int]:
        """Return processor seconds by process, and resident bytes in all."""
        seconds: dict[tuple[int, float], float] = {}
        memory = 0
        for process in (self._own, *self._own.children(recursive=True)):
            try:
                times, held = process.cpu_times(), process.memory_info().rss
                seconds[process.pid, process.create_time()] = times.user + times.system
            except psutil.Error:
                # It ended while we looked, or is not ours to look at.
                continue
            memory += held
        return seconds, memory
