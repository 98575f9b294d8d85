"""Claims jobs from a source, keeps an executor full, and reports outcomes.

A job is held from its claim until the source has acknowledged its outcome, or says that somebody else has
it by now.  While the source is silent everything held is kept, and what has ended waits to be reported: only
the source knows whether a lease ran out, and its fence refuses what comes too late.
"""

import logging
import time
from collections import Counter
from collections.abc import Callable

from workers.backoff import Backoff
from workers.executor import Executor, ExecutorError, Finished, Ticket
from workers.heartbeat import Heartbeat
from workers.job import (
    MOST_REPORTS,
    ClaimAnswer,
    ClaimRequest,
    CompleteManyRequest,
    CompleteRequest,
    Ending,
    JobOutcome,
    WorkerInfo,
    wall_limit_s,
)
from workers.source import Faulty, JobSource, SourceError, StaleAttempt, Unacceptable, Unreachable
from workers.usage import Usage

__all__ = ["Dispatcher", "StaleAttempt"]

log = logging.getLogger(__name__)

#: Longest wait for an outcome before new jobs are asked for again [s].
PATIENCE_S = 0.2
#: Longest pause between two questions for jobs when there were none [s].
IDLE_S = 1.0
#: Time that running solves have to stop by themselves before they are killed, and that there is then to
#: report what they had [s].
GRACE_S = 3.0
REPORT_S = 5.0
#: Jobs of one claim, at most.
MOST_CLAIMED = 1000
#: How often the source may fail over a report before it is given up.
MOST_FAULTS = 10


class Dispatcher:
    """One worker: a source, an executor, and the jobs in between."""

    def __init__(
        self,
        source: JobSource,
        executor: Executor,
        worker: WorkerInfo,
        campaign_id: int | None = None,
        usage: Usage | None = None,
    ) -> None:
        self._source = source
        self._executor = executor
        self._worker = worker
        self._usage = usage
        self._campaign_id = campaign_id
        #: When the process of each job that is worked on counts as hung.
        self._running: dict[Ticket, float] = {}
        self._unreported: dict[Ticket, JobOutcome] = {}
        self._n_faults: Counter[Ticket] = Counter()
        self._hung: set[Ticket] = set()
        #: Somebody else's by now, but not yet out of the executor.
        self._disowned: set[Ticket] = set()
        self._line = Backoff()
        self._idle = Backoff(PATIENCE_S, IDLE_S)
        self._heartbeat = Heartbeat(source, self._info, self.held)

    def held(self) -> list[Ticket]:
        """Return the attempts whose leases are to be extended; any thread may ask."""
        # A copy of a dict's keys is one step of the interpreter: nothing changes in between.
        held = {*list(self._running), *list(self._unreported)}
        return sorted(held.difference(list(self._disowned)))

    def run(self, stop: Callable[[], bool]) -> None:
        """Work until told to stop, then give running solves a moment to hand in what they have."""
        with self._heartbeat:
            try:
                while not stop():
                    self.step()
                self._drain()
            except ExecutorError as error:
                self._lose_all(str(error))
                raise

    def step(self) -> bool:
        """Claim, obey, collect and report once; return whether anything is held."""
        self._claim()
        self._obey()
        self._kill_hung()
        self._collect()
        self._report()
        return bool(self._running or self._unreported)

    def _info(self) -> WorkerInfo:
        need = self._usage and self._usage.read()
        return self._worker.model_copy(update={"slots": self._executor.capacity(), **(need or {})})

    def _claim(self) -> None:
        n_free = self._executor.capacity() - len(self._running)
        # Whoever cannot hand in what it has done needs no more of it.
        if n_free <= 0 or self._unreported or not (self._line.is_due() and self._idle.is_due()):
            return
        n_jobs = min(n_free, MOST_CLAIMED)
        request = ClaimRequest(worker=self._info(), n_jobs=n_jobs, campaign_id=self._campaign_id)
        try:
            answer = self._source.claim(request)
        except Unreachable as error:
            self._wait(error)
            return
        self._line.succeeded()
        self._accept(answer)
        if len(answer.claims) < n_jobs:
            self._idle.failed()
        else:
            self._idle.succeeded()

    def _accept(self, answer: ClaimAnswer) -> None:
        self._heartbeat.period_s = answer.heartbeat_s
        for claim in answer.claims:
            ticket = Ticket(claim.job_id, claim.attempt)
            self._running[ticket] = time.monotonic() + wall_limit_s(claim.job)
            self._executor.submit(ticket, claim.job)

    def _obey(self) -> None:
        for answer in self._heartbeat.answers():
            for job in answer.to_cancel:
                self._executor.cancel(Ticket(job.job_id, job.attempt))
            for job in answer.not_held:
                self._disown(Ticket(job.job_id, job.attempt))

    def _disown(self, ticket: Ticket) -> None:
        if self._unreported.pop(ticket, None) is None and ticket in self._running:
            self._disowned.add(ticket)
            self._executor.cancel(ticket, force=True)

    def _kill_hung(self) -> None:
        # A solve looks at the clock itself; whoever comes here is stuck where nobody looks.
        for ticket, end in self._running.items():
            if time.monotonic() > end and ticket not in self._hung:
                self._hung.add(ticket)
                self._executor.cancel(ticket, force=True)

    def _collect(self) -> None:
        end = time.monotonic() + PATIENCE_S
        # Asked even if nothing runs: so an executor that is lost is noticed in time.
        for finished in self._executor.finished(PATIENCE_S):
            self._take(finished)
        if not self._running and not (self._unreported and self._line.is_due()):
            # Nothing can finish, which some executors say at once.
            time.sleep(max(0.0, end - time.monotonic()))

    def _take(self, finished: Finished) -> None:
        ticket, outcome = finished
        if ticket in self._hung and outcome.ending is Ending.CANCELLED:
            outcome = JobOutcome(ending=Ending.TIMEOUT, error="job: expected an outcome in time, got none")
        if ticket not in self._disowned:
            self._unreported[ticket] = outcome
        self._running.pop(ticket, None)
        self._hung.discard(ticket)
        self._disowned.discard(ticket)

    def _report(self) -> None:
        if len(self._unreported) > 1 and self._line.is_due():
            self._report_many()
        for ticket in list(self._unreported):
            if not self._line.is_due():
                return
            try:
                self._send(ticket)
            except Unreachable as error:
                self._wait(error)

    def _report_many(self) -> None:
        tickets = list(self._unreported)[:MOST_REPORTS]
        try:
            self._source.complete_many(CompleteManyRequest(reports=tuple(map(self._request, tickets))))
        except (Faulty, Unacceptable, StaleAttempt):
            # None was taken.  Sent one by one, they tell which of them it is.
            return
        except Unreachable as error:
            self._wait(error)
        else:
            for ticket in tickets:
                self._settle(ticket)

    def _request(self, ticket: Ticket) -> CompleteRequest:
        outcome = self._unreported[ticket]
        return CompleteRequest(job_id=ticket.job_id, attempt=ticket.attempt, outcome=outcome)

    def _send(self, ticket: Ticket) -> None:
        try:
            self._source.complete(self._request(ticket))
        except Faulty as error:
            self._n_faults[ticket] += 1
            if self._n_faults[ticket] < MOST_FAULTS:
                raise
            self._replace(ticket, error)
        except Unacceptable as error:
            self._replace(ticket, error)
        except StaleAttempt as error:
            # Somebody else has the job now; the fence has done its work.
            log.info("%s", error, extra=_ids(ticket))
            self._settle(ticket)
        else:
            self._settle(ticket)

    def _settle(self, ticket: Ticket) -> None:
        del self._unreported[ticket]
        self._n_faults.pop(ticket, None)
        self._line.succeeded()
        self._idle.succeeded()

    def _replace(self, ticket: Ticket, error: SourceError) -> None:
        """Report, in place of what is not taken, that it is not, so that somebody sees it."""
        text = "job %d: expected a report that is accepted, got %s"
        log.error(text, ticket.job_id, error, extra=_ids(ticket))
        if self._unreported[ticket].ending is Ending.ERROR:
            # Not even this: the job comes back when its lease has run out.
            self._settle(ticket)
            return
        self._unreported[ticket] = JobOutcome(ending=Ending.ERROR, error=f"report: {error}")
        self._n_faults.pop(ticket, None)

    def _wait(self, error: Unreachable) -> None:
        log.warning("%s; asked again in %.1f s", error, self._line.failed(error.wait_s))

    def _drain(self) -> None:
        for force, patience_s in ((False, GRACE_S), (True, REPORT_S)):
            for ticket in self._running:
                self._executor.cancel(ticket, force)
            deadline = time.monotonic() + patience_s
            while (self._running or (force and self._unreported)) and time.monotonic() < deadline:
                self._collect()
                self._report()

    def _lose_all(self, reason: str) -> None:
        for ticket in list(self._running):
            self._take(Finished(ticket, JobOutcome(ending=Ending.LOST, error=reason)))
        deadline = time.monotonic() + REPORT_S
        while self._unreported and time.monotonic() < deadline:
            self._report()
            time.sleep(0.0 if self._line.is_due() else PATIENCE_S)


def _ids(ticket: Ticket) -> dict[str, int]:
    return {"job": ticket.job_id, "attempt": ticket.attempt}
