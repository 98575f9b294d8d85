"""Where jobs come from: the coordinator, behind five calls that carry messages of `workers.job` alone.

SourceError(RuntimeError)   a source that did not do what it was asked
Unreachable             no answer now; the same may be asked again
Faulty              it failed over this very question
Refused                 it will not work with this worker: its token, its version
Unacceptable            it will not take this report, however often it comes
StaleAttempt            the attempt no longer holds the job; the report changes nothing
"""

from typing import Protocol

from core.errors import UserError
from workers.job import (
    ClaimAnswer,
    ClaimRequest,
    CompleteAnswer,
    CompleteManyAnswer,
    CompleteManyRequest,
    CompleteRequest,
    HandInAnswer,
    HandInRequest,
    HeartbeatAnswer,
    HeartbeatRequest,
)


class SourceError(UserError, RuntimeError):
    """A source that did not do what it was asked."""


class Unreachable(SourceError):
    """No answer now; the same may be asked again, and `wait_s` is how soon at the earliest."""

    def __init__(self, detail: str, wait_s: float = 0.0, status: int | None = None) -> None:
        super().__init__(detail)
        self.wait_s = wait_s
        #: None where nobody answered.
        self.status = status


class Faulty(Unreachable):
    """A source that failed over this very question, and will perhaps fail over it every time."""


class Refused(SourceError):
    """The source will not work with this worker; somebody has to look at its token or its version."""


class Unacceptable(SourceError):
    """A report that the source will not take, however often it comes."""


class StaleAttempt(SourceError):
    """A report on an attempt that no longer holds its job, or that another token claimed; nothing changes."""


class JobSource(Protocol):
    """Five calls, each of which may be repeated when its answer got lost, and each raises `SourceError`."""

    def claim(self, request: ClaimRequest) -> ClaimAnswer:
        """Return jobs, which are then this worker's for the time of a lease."""

    def heartbeat(self, request: HeartbeatRequest) -> HeartbeatAnswer:
        """Extend the leases of what is held; return what is to be cancelled, and what is lost."""

    def hand_in(self, request: HandInRequest) -> HandInAnswer:
        """Report hops of a chain that goes on."""

    def complete(self, request: CompleteRequest) -> CompleteAnswer:
        """Report an outcome."""

    def complete_many(self, request: CompleteManyRequest) -> CompleteManyAnswer:
        """Report several outcomes; all are taken, or what is raised holds for one of them and none is."""
