"""Runs jobs in the calling process, one at a time: for tests and for debugging."""

from collections import deque
from collections.abc import Callable

from workers.executor import ExecutorError, Finished, HandedIn, Ticket
from workers.job import Ending, Job, JobOutcome

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
            done.append(Finished(ticket, self._runner(job, self._stop)))
        return done

    def handed_in(self) -> list[HandedIn]:
        """Return nothing: whoever asks waits for the outcome in the same thread."""
        return []

    def cancel(self, ticket: Ticket, force: bool = False) -> None:
        """Drop a job that has not begun; one that runs has the caller's thread and cannot be asked."""
        for waiting in [entry for entry in self._waiting if entry[0] == ticket]:
            self._waiting.remove(waiting)
            self._cancelled.append(Finished(ticket, JobOutcome(ending=Ending.CANCELLED)))

    def close(self) -> None:
        """Forget what was submitted."""
        self._waiting.clear()
