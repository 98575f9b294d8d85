"""The processes below this one: killing them all, what they use, and one numerical thread for each.

This file imports nothing heavy, since the environment must be set before numpy is first imported.
"""

import ctypes
import sys
import threading
import time
from collections.abc import Iterable, Mapping
from typing import TypedDict

import psutil

from workers.messages import WorkerError

_PR_SET_CHILD_SUBREAPER = 36


def adopt_orphans() -> None:
    """Become the parent of processes that killed descendants leave behind.

    Else nobody could tell any more whose they were.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def kill(processes: Iterable[psutil.Process]) -> None:
    """Kill processes without waiting for them; those that have exited are ignored."""
    for process in processes:
        try:
            process.kill()
        except psutil.NoSuchProcess:
            continue


def kill_descendants() -> None:
    """Kill all descendants of this process."""
    kill(psutil.Process().children(recursive=True))


#: Claims may come many times a second; usage is a mean over some seconds [s].
KEPT_S = 3.0


class Need(TypedDict):
    """The fields of `workers.messages.WorkerInfo` that are measured."""

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
        """Return the recent usage, or None in the first seconds."""
        with self._lock:
            passed = time.monotonic() - self._at
            if passed >= self._kept_s:
                self._last = self._measure(passed)
            return self._last

    def _measure(self, passed: float) -> Need:
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


#: Read by the BLAS, OpenMP and numba run-times when they are loaded.
THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMBA_NUM_THREADS",
)


def single_threaded(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment in which numerical libraries start with one thread."""
    return dict(environment) | dict.fromkeys(THREAD_VARIABLES, "1")


class ThreadError(WorkerError):
    """A numerical library runs more threads than the one a solve may have."""


def require_one_thread() -> None:
    """Raise unless every loaded BLAS and OpenMP library runs one thread."""
    from threadpoolctl import threadpool_info

    for library in threadpool_info():
        if library["num_threads"] != 1:
            name = library.get("internal_api", "library")
            raise ThreadError(f"threads of {name}: expected 1, got {library['num_threads']}")
