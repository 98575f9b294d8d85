"""The protocol of everything that runs jobs: inline, a pool of processes, a Ray cluster.

An executor may forget all it holds at any time; the coordinator's database is the only truth.

    ExecutorError(RuntimeError)   asked for what it cannot do
        ExecutorLost              it no longer answers; a new one must be started
"""

from typing import NamedTuple, Protocol

from core.errors import UserError
from workers.job import ChainPart, Job, JobOutcome

#: Time that an attempt has to stop by itself after it was asked, before it is killed [s].
CANCEL_GRACE_S = 10.0


class Ticket(NamedTuple):
    """One attempt at one job."""

    job_id: int
    attempt: int


class Finished(NamedTuple):
    """An attempt that ended, whatever the ending."""

    ticket: Ticket
    outcome: JobOutcome


class HandedIn(NamedTuple):
    """Hops of a chain that an attempt still works on."""

    ticket: Ticket
    part: ChainPart


class ExecutorError(UserError, RuntimeError):
    """An executor that was asked for what it cannot do."""


class ExecutorLost(ExecutorError):
    """An executor that no longer answers: what it held is lost, and its process had better end."""


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
        ExecutorLost
            When nothing can be expected from this executor any more.
        """

    def handed_in(self) -> list[HandedIn]:
        """Return what attempts have handed in since this was asked last; never waits.

        All of it is in their outcomes as well, so an executor may know of none.
        """

    def cancel(self, ticket: Ticket, force: bool = False) -> None:
        """Ask an attempt to stop and kill it after a grace, or kill it now; unknown tickets are ignored."""

    def close(self) -> None:
        """Stop everything, and give back all resources."""
