"""A few threads for requests that keep a processor busy for seconds, and few who wait for them.

What computes a spiral or an orbit must not take the threads on which claims, heartbeats and reads are
answered.

    BusyError(RuntimeError)   as many heavy requests as there is room for
"""

from collections.abc import Callable
from functools import partial
from typing import ParamSpec, TypeVar

import anyio
import anyio.to_thread

P = ParamSpec("P")
R = TypeVar("R")

#: Heavy requests that run at once, those that may wait for them, and after which time to ask again [s].
N_RUNNING, N_WAITING, BUSY_PAUSE_S = 2, 8, 10


class BusyError(RuntimeError):
    """As many heavy requests as there is room for."""


class HeavyWork:
    """Runs heavy requests on threads of their own; used from one event loop."""

    def __init__(self, n_running: int = N_RUNNING, n_waiting: int = N_WAITING) -> None:
        self._limiter = anyio.CapacityLimiter(n_running)
        self._most = n_running + n_waiting
        self._n_inside = 0

    async def run(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Return what a function returns, or raise a BusyError at once."""
        if self._n_inside >= self._most:
            raise BusyError(
                f"submissions and checks: expected fewer than {self._most} at once, got as many; "
                f"wait {BUSY_PAUSE_S} s"
            )
        self._n_inside += 1
        try:
            return await anyio.to_thread.run_sync(partial(function, *args, **kwargs), limiter=self._limiter)
        finally:
            self._n_inside -= 1
