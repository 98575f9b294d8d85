"""The protocol of everything that runs jobs, and the executor that runs them in the calling process.

An executor may lose all it holds at any time; the coordinator's database is the only truth.

    ExecutorError(WorkerError)    asked for what it cannot do
        ExecutorLostError         it no longer answers; a new one must be started
"""

from collections import deque
from collections.abc import Callable
from typing import Protocol

from core.errors import UserError
from workers.errors import WorkerError
from workers.messages import Ended, Ending, Finished, HandedIn, Job, JobOutcome, Sealed, Ticket, sealed

#: Time that an attempt has to stop by itself after it was asked, before it is killed [s].
CANCEL_GRACE_S = 10.0


class ExecutorError(UserError, WorkerError):
    """An executor that was asked for what it cannot do."""


class ExecutorLostError(ExecutorError):
    """An executor that no longer answers; its jobs are lost, and its process should exit."""


class Executor(Protocol):
    """Runs jobs; every ticket that was submitted comes back exactly once from `finished`."""

    def capacity(self) -> int:
        """Return how many jobs run at once."""

    def submit(self, ticket: Ticket, job: Job) -> None:
        """Accept a job; never more than `capacity` at a time."""

    def finished(self, timeout: float) -> list[Finished]:
        """Return what has ended, after waiting at most `timeout` seconds for a first one.

        Raises
        ------
        ExecutorLostError
            When nothing can be expected from this executor any more.
        """

    def handed_in(self) -> list[HandedIn]:
        """Return what attempts have handed in since this was asked last; never waits.

        All of it is in their outcomes as well, so an executor may know of none.
        """

    def cancel(self, ticket: Ticket, force: bool = False) -> None:
        """Ask an attempt to stop and kill it after a grace, or kill it now; unknown tickets are ignored."""

    def close(self) -> None:
        """Stop all jobs and release all resources."""


Runner = Callable[[Job, Callable[[], bool]], JobOutcome]


class Inline:
    """An executor without concurrency: `finished` runs the job that was submitted first."""

    def __init__(self, runner: Runner, stop: Callable[[], bool] = lambda: False) -> None:
        self._runner = runner
        #: Seen by the job that runs, since its thread is the caller's.
        self._stop = stop
        self._waiting: deque[tuple[Ticket, Job]] = deque()
        self._cancelled: list[Finished] = []

    def capacity(self) -> int:
        """Return 1."""
        return 1

    def submit(self, ticket: Ticket, job: Job) -> None:
        """Accept one job; it runs in the next call of `finished`."""
        if len(self._waiting) >= self.capacity():
            raise ExecutorError(
                f"inline executor: expected at most 1 job at a time, got job {ticket.job_id} too"
            )
        self._waiting.append((ticket, job))

    def finished(self, timeout: float) -> list[Finished]:
        """Run what was submitted; never waits."""
        done, self._cancelled = self._cancelled, []
        while self._waiting:
            ticket, job = self._waiting.popleft()
            done.append(Finished(ticket, sealed(Ended, self._runner(job, self._stop))))
        return done

    def handed_in(self) -> list[HandedIn]:
        """Return nothing: whoever asks waits for the outcome in the same thread."""
        return []

    def cancel(self, ticket: Ticket, force: bool = False) -> None:
        """Drop a job that has not begun; one that runs has the caller's thread and cannot be asked."""
        for waiting in [entry for entry in self._waiting if entry[0] == ticket]:
            self._waiting.remove(waiting)
            self._cancelled.append(Finished(ticket, Sealed(Ended(ending=Ending.CANCELLED))))

    def close(self) -> None:
        """Drop what was submitted."""
        self._waiting.clear()
