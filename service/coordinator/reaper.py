"""Expires leases and prunes old rows, periodically."""

import logging
import threading
import time
from collections.abc import Callable

from service.db.errors import UnavailableError
from service.store.store import Store

log = logging.getLogger(__name__)


class Reaper:
    """Runs every `reap_s`; the first leases expire a whole lease after the start.

    Workers that outlived the coordinator before this one have that long to renew theirs.  The same holds
    after time in which no worker could: all leases begin again, and no job fails, when this thread wakes up
    late, since its machine or its process stood still; when the clock of leases has moved against the
    monotonic one, since it was set or the machine slept; and when the archive took no writes.
    """

    def __init__(
        self, store: Store, stop: threading.Event, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._store = store
        self._stop = stop
        self._clock = clock
        self._seen = (clock(), store.now())
        self._next = self._seen[0] + store.leases.reap_s
        self._first_reap = self._seen[0] + store.leases.lease_s
        self._n_faults = store.gauges.write_times[2]
        self._has_failed = False

    def run(self) -> None:
        """Run until told to stop."""
        while not self._stop.wait(max(0.0, self._next - self._clock())):
            self.step()

    def step(self) -> int:
        """Reap if it is time; return how many jobs went back."""
        woken = self._clock()
        if woken < self._next:
            return 0
        late_s, self._next = woken - self._next, woken + self._store.leases.reap_s
        try:
            n_lost = self._reap(woken, late_s)
            self._store.prune()
        except UnavailableError as error:
            self._has_failed = True
            self._store.downtime.tell(error)
            return 0
        except Exception:
            # If it ended this thread, no lease would ever expire.
            self._has_failed = True
            log.exception("reaping failed")
            return 0
        if n_lost:
            log.warning("%d jobs lost their workers and go back", n_lost)
        return n_lost

    def _reap(self, woken: float, late_s: float) -> int:
        now, n_faults = self._store.now(), self._store.gauges.write_times[2]
        if reason := self._interruption(woken, now, late_s, n_faults):
            n_renewed = self._store.renew_leases()
            if n_renewed:
                log.warning("leases: %s; %d running jobs get a new one", reason, n_renewed)
        self._seen, self._n_faults, self._has_failed = (woken, now), n_faults, False
        # At the time that was looked at: the clock may be set before the archive is asked.
        return self._store.reap(now) if woken >= self._first_reap else 0

    def _interruption(self, woken: float, now: float, late_s: float, n_faults: int) -> str:
        """Return what kept workers from renewing their leases since the last look, or nothing."""
        leases = self._store.leases
        # What is shorter leaves time for a heartbeat.
        least_s = (leases.lease_s - leases.heartbeat_s) / 2.0
        moved_s = (now - self._seen[1]) - (woken - self._seen[0])
        if late_s > least_s:
            return f"expected to look after {leases.reap_s:g} s, got {late_s:.0f} s more, as after a pause"
        if abs(moved_s) > least_s:
            return f"expected a steady clock, got one that moved by {moved_s:+.0f} s, as after a sleep"
        if self._has_failed or n_faults != self._n_faults:
            return "expected an archive that takes writes, got one that did not for a while"
        return ""
