"""Notices a Ray cluster that no longer runs tasks; without it a dispatcher would hang with its jobs."""

import faulthandler
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from workers.executor import ExecutorLost
from workers.ray_task import answer


@contextmanager
def ended_after(seconds: float) -> Iterator[None]:
    """End this process, with exit code 1, if the block takes longer, even if no thread of ours can run.

    Ray holds the interpreter while it waits for its raylet, which replies to a driver once its first workers
    have registered; if one of them is killed while it starts, that is never.
    """
    faulthandler.dump_traceback_later(seconds, exit=True, file=sys.__stderr__ or sys.stderr)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


class Watchdog:
    """Asks the cluster now and then to do nothing, since calls wait for ever once its raylet is dead."""

    def __init__(self, ray: Any, interval_s: float = 5.0, timeout_s: float = 10.0) -> None:
        self._ray = ray
        self._task = self._ray.remote(num_cpus=0, max_retries=0)(answer)
        self._interval_s = interval_s
        self._timeout_s = timeout_s
        self._next = time.monotonic() + interval_s
        self._asked: tuple[Any, float] | None = None
        self._n_missed = 0

    def look(self) -> None:
        """Ask, or look for the answer; raise ExecutorLost when there were two in a row without one."""
        now = time.monotonic()
        if self._asked is None:
            if now >= self._next:
                self._asked = (self._task.remote(), now)
            return
        reference, since = self._asked
        if self._ray.wait([reference], timeout=0)[0]:
            self._asked, self._next = None, now + self._interval_s
            self._count(self._is_answer(reference))
        elif now - since > self._timeout_s:
            self._asked, self._next = None, now
            self._count(False)

    def _is_answer(self, reference: Any) -> bool:
        try:
            self._ray.get(reference, timeout=self._timeout_s)
        except self._ray.exceptions.RayError:
            # Its process may have been killed, as that of any job; once the raylet is dead, and the cluster
            # has noticed, every answer is an error.
            return False
        return True

    def _count(self, is_answer: bool) -> None:
        self._n_missed = 0 if is_answer else self._n_missed + 1
        if self._n_missed == 2:
            raise ExecutorLost(
                f"ray cluster: expected an answer in {self._timeout_s:g} s, got none or an error, twice; "
                "start the dispatcher again"
            )
