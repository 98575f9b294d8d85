"""Claims jobs from a source, keeps an executor full, and reports outcomes.

The source is the coordinator, here behind three calls that carry messages of `workers.job` alone, so that
it may as well stand at the other end of a network.
"""

import time
from collections.abc import Callable, Iterable, Sequence
from typing import Protocol

from workers.executor import Executor, Finished, Ticket
from workers.job import Claim, Ending, JobOutcome, wall_limit_s

#: Longest wait for an outcome before new jobs are asked for again [s].
PATIENCE_S = 0.2
#: Time that running solves have to stop by themselves before they are killed [s].
GRACE_S = 3.0


class StaleAttempt(RuntimeError):
    """A report that came after the job went to another attempt, or was finished; it changes nothing."""


class JobSource(Protocol):
    """Where jobs come from and outcomes go."""

    def claim(self, worker: str, n_jobs: int) -> Sequence[Claim]:
        """Return at most `n_jobs` jobs, which are then this worker's."""

    def heartbeat(self, worker: str, held: Iterable[Ticket]) -> Sequence[Ticket]:
        """Say what is still being worked on; return what is to be cancelled."""

    def complete(self, ticket: Ticket, outcome: JobOutcome) -> None:
        """Report an outcome.

        Raises
        ------
        StaleAttempt
            When the attempt no longer holds the job.
        """


class Dispatcher:
    """One worker: a source, an executor, and the jobs in between."""

    def __init__(self, source: JobSource, executor: Executor, worker: str, heartbeat_s: float = 1.0) -> None:
        self._source = source
        self._executor = executor
        self._worker = worker
        self._heartbeat_s = heartbeat_s
        self._next_heartbeat = 0.0
        #: When the process of each job that is worked on counts as hung.
        self._held: dict[Ticket, float] = {}
        self._hung: set[Ticket] = set()

    def run(self, stop: Callable[[], bool]) -> None:
        """Work until told to stop, then give running solves a moment to hand in what they have."""
        while not stop():
            self.step()
        self._drain()

    def step(self) -> bool:
        """Claim, beat, collect once; return whether anything is being worked on."""
        self._fill()
        self._beat()
        self._kill_hung()
        self._collect(PATIENCE_S)
        return bool(self._held)

    def _fill(self) -> None:
        n_free = self._executor.capacity() - len(self._held)
        for claim in self._source.claim(self._worker, n_free) if n_free else ():
            ticket = Ticket(claim.job_id, claim.attempt)
            self._held[ticket] = time.monotonic() + wall_limit_s(claim.job)
            self._executor.submit(ticket, claim.job)

    def _beat(self) -> None:
        if time.monotonic() < self._next_heartbeat:
            return
        self._next_heartbeat = time.monotonic() + self._heartbeat_s
        for ticket in self._source.heartbeat(self._worker, sorted(self._held)):
            self._executor.cancel(ticket)

    def _kill_hung(self) -> None:
        # A solve looks at the clock itself; whoever comes here is stuck where nobody looks.
        for ticket, end in self._held.items():
            if time.monotonic() > end and ticket not in self._hung:
                self._hung.add(ticket)
                self._executor.cancel(ticket, force=True)

    def _collect(self, timeout: float) -> None:
        if not self._held:
            # Nothing can finish: wait for new jobs without spinning.
            time.sleep(timeout)
            return
        for finished in self._executor.finished(timeout):
            self._report(finished)

    def _report(self, finished: Finished) -> None:
        self._held.pop(finished.ticket, None)
        outcome = finished.outcome
        if finished.ticket in self._hung and outcome.ending is Ending.CANCELLED:
            outcome = JobOutcome(ending=Ending.TIMEOUT, error="job: expected an outcome in time, got none")
        self._hung.discard(finished.ticket)
        try:
            self._source.complete(finished.ticket, outcome)
        except StaleAttempt:
            # Somebody else has the job now; the fence has done its work.
            return

    def _drain(self) -> None:
        for ticket in self._held:
            self._executor.cancel(ticket)
        deadline = time.monotonic() + GRACE_S
        while self._held and time.monotonic() < deadline:
            self._collect(PATIENCE_S)
        for ticket in self._held:
            self._executor.cancel(ticket, force=True)
        while self._held:
            self._collect(PATIENCE_S)
