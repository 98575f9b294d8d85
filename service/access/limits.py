"""How much one client may ask for: a bucket of requests each, and a number of open streams.

And how many requests of people run at once, so that workers find a thread and a processor.  All of it lives
in the memory of the web server and is used from its event loop alone.
"""

import asyncio
import math
import time
from collections import Counter, OrderedDict
from collections.abc import Callable

#: Clients that are remembered; the one seen longest ago is forgotten first.
MAX_CLIENTS = 10_000
#: How long a request waits for its turn [s].
PATIENCE_S = 60.0


class Buckets:
    """A bucket per client: each request takes one of `burst`, and `rate_per_s` flow back."""

    def __init__(self, rate_per_s: float, burst: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate = rate_per_s
        self._burst = burst
        self._clock = clock
        self._levels: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, client: str) -> int:
        """Take one; return 0, or the seconds after which there is one again."""
        now = self._clock()
        level, seen = self._levels.pop(client, (float(self._burst), now))
        level = min(self._burst, level + (now - seen) * self._rate)
        is_granted = level >= 1.0
        self._levels[client] = (level - is_granted, now)
        if len(self._levels) > MAX_CLIENTS:
            self._levels.popitem(last=False)
        return 0 if is_granted else math.ceil((1.0 - level) / self._rate)


class Streams:
    """Open streams per client."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._open: Counter[str] = Counter()

    @property
    def n_open(self) -> int:
        """How many are open in all."""
        return self._open.total()

    def enter(self, client: str) -> bool:
        """Count one more, unless there are enough."""
        if self._open[client] >= self._most:
            return False
        self._open[client] += 1
        return True

    def leave(self, client: str) -> None:
        """Count one less."""
        self._open[client] -= 1
        if not self._open[client]:
            del self._open[client]


class Turns:
    """Requests take turns: few run at once, the others wait in the order in which they came."""

    def __init__(self, at_once: int) -> None:
        self._turns = asyncio.Semaphore(at_once)

    async def enter(self) -> bool:
        """Wait for a turn; return whether it came in time."""
        try:
            await asyncio.wait_for(self._turns.acquire(), PATIENCE_S)
        except TimeoutError:
            return False
        return True

    def leave(self) -> None:
        """End a turn."""
        self._turns.release()
