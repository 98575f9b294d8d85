"""Claims jobs from a source, keeps an executor full, and reports outcomes.

A job is held from its claim until the source has acknowledged its outcome, or says that somebody else has
it by now.  While the source is silent everything held is kept, and what has ended waits to be reported, for
hours if need be, and in files that the next dispatcher finds: only the source knows whether a lease ran out,
and its fence refuses what comes too late.

What a coordinator has not taken yet waits in the outbox, a folder of files.  A file is the body of
`POST /jobs/complete` as it stands, `job-17-attempt-1.json`, written whole or not at all.  The next dispatcher
of the same folder offers what it finds there.  What is refused for good is moved to `refused`, where somebody
may look at it, mend the reason and move it back.  Heartbeats are sent from a thread of their own: a solve in
the dispatcher's thread must not delay them.
"""

import logging
import os
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Self

from pydantic import ValidationError

from workers.executor import Executor, ExecutorError
from workers.messages import (
    MOST_HELD,
    MOST_REPORTS,
    RESULTS,
    ClaimAnswer,
    ClaimRequest,
    CompleteAnswer,
    CompleteRequest,
    Ended,
    Ending,
    FaultyError,
    Finished,
    HandedIn,
    HeartbeatAnswer,
    HeartbeatRequest,
    HeldJob,
    JobSource,
    Reached,
    Sealed,
    SourceError,
    StaleAttemptError,
    Ticket,
    UnacceptableError,
    UnreachableError,
    WorkerInfo,
    job_digest,
    sealed,
    wall_limit_s,
)
from workers.process_tree import Usage
from workers.retry import Awake, Backoff, Downtime

log = logging.getLogger(__name__)


class Outbox:
    """A folder of reports; a disk that takes none is logged, and never stops the work."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def reports(self) -> Iterator[Finished]:
        """Yield the outcomes that an earlier dispatcher could not report."""
        for path in sorted(self.folder.glob("job-*.json")):
            try:
                report = CompleteRequest.model_validate_json(path.read_bytes())
                yield Finished(report.ticket, sealed(Ended, report.outcome), report.job_digest)
            except (OSError, ValidationError) as error:
                log.error(
                    "outcome %s: expected a report of this version, got %s; left where it is", path, error
                )

    def put(self, report: Finished) -> bool:
        """Write a report; return whether it is on disk."""
        return self._write(self.folder, report) is not None

    def remove(self, ticket: Ticket) -> None:
        """Delete a report that was accepted."""
        try:
            (self.folder / _name(ticket)).unlink(missing_ok=True)
        except OSError as error:
            # It is offered again after the next start, and answered as a report that came twice.
            log.warning("outcome of job %d: expected to remove its file, got %s", ticket.job_id, error)

    def set_aside(self, report: Finished) -> Path | None:
        """Move a report to the rejected ones; return its path."""
        path = self._write(self.folder / "refused", report)
        if path is not None:
            self.remove(report.ticket)
        return path

    def _write(self, folder: Path, report: Finished) -> Path | None:
        path = folder / _name(report.ticket)
        draft = path.with_name(f"{path.name}.{os.getpid()}")
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            # Results are for their owner alone, as the archive is.
            descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
            with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
                stream.write(report.to_json())
            draft.replace(path)
        except OSError as error:
            log.error("outcome of job %d: expected room for %s, got %s", report.ticket.job_id, path, error)
            return None
        return path


def _name(ticket: Ticket) -> str:
    return f"job-{ticket.job_id}-attempt-{ticket.attempt}.json"


#: How soon after its start a worker is heard of, before it knows how often it has to be [s].
FIRST_PERIOD_S = 0.25
#: How often it is asked in between what to cancel, which writes nothing [s].
LOOK_S = 0.5


class Heartbeat:
    """Periodically reports the held jobs and collects the answers."""

    def __init__(
        self,
        source: JobSource,
        info: Callable[[], WorkerInfo],
        held: Callable[[], Sequence[Ticket]],
        downtime: Downtime,
    ) -> None:
        #: As the source wants it [s].
        self.period_s = FIRST_PERIOD_S
        self._source = source
        self._info = info
        self._held = held
        self._downtime = downtime
        self._answers: queue.SimpleQueue[HeartbeatAnswer] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="heartbeat", daemon=True)
        self._fault: Exception | None = None

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop; do not wait for an in-flight request."""
        self._stop.set()

    def answers(self) -> Iterator[HeartbeatAnswer]:
        """Return the answers that have arrived; raise what ended the thread, if something did."""
        if self._fault is not None:
            raise self._fault
        while not self._answers.empty():
            yield self._answers.get()

    def beat(self, extend: bool = True) -> None:
        """Send one heartbeat, to extend the leases or only to learn what to cancel."""
        held = [HeldJob(**ticket._asdict()) for ticket in self._held()]
        for first in range(0, max(1, len(held)), MOST_HELD):
            part = tuple(held[first : first + MOST_HELD])
            request = HeartbeatRequest(worker=self._info(), held=part, extend=extend)
            self._answers.put(self._source.heartbeat(request))

    def look(self) -> None:
        """Ask what to cancel, if anything is held."""
        if self._held():
            self.beat(extend=False)

    def _run(self) -> None:
        backoff, pause_s = Backoff(), self.period_s
        next_beat = time.monotonic() + pause_s
        while not self._stop.wait(pause_s):
            try:
                if time.monotonic() < next_beat:
                    self.look()
                else:
                    self.beat()
                    next_beat = time.monotonic() + self.period_s
                backoff.succeeded()
                pause_s = min(LOOK_S, max(0.0, next_beat - time.monotonic()))
            except UnreachableError as error:
                self._downtime.tell(f"heartbeat: {error}")
                pause_s = min(backoff.failed(error.wait_s), self.period_s)
            except Exception as fault:
                self._fault = fault
                return


#: Longest wait for an outcome before new jobs are asked for again [s].
PATIENCE_S = 0.2
#: Longest pause between two questions for jobs when there were none [s].
IDLE_S = 1.0
#: Time that running solves have to stop by themselves before they are killed, and that there is then to
#: report what they had [s].
GRACE_S = 1.5
REPORT_S = 1.5
#: Jobs of one claim, at most.
MOST_CLAIMED = 1000
#: How often the source may fail over a report, and be well in between, before it is given up.
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
        outbox: Outbox | None = None,
    ) -> None:
        self._source = source
        self._executor = executor
        self._worker = worker
        self._usage = usage
        self._campaign_id = campaign_id
        self._awake = Awake()
        #: When the process of each job that is worked on counts as hung, by the time that we were awake.
        self._running: dict[Ticket, float] = {}
        self._unreported: dict[Ticket, Sealed[Ended]] = {}
        #: By `job_digest`, of all that is held.
        self._digests: dict[Ticket, str] = {}
        #: Hops of chains that go on, not handed in yet; and the first hop of each that is not.
        self._parts: dict[Ticket, Sealed[Reached]] = {}
        self._next_hops: dict[Ticket, int] = {}
        self._outbox = outbox
        #: Those of the unreported that are in the outbox; and those that an earlier dispatcher left there.
        self._kept: set[Ticket] = set()
        self._adopted: set[Ticket] = set()
        self._n_faults: Counter[Ticket] = Counter()
        #: How often the source has shown that it can write, and how often it had when it failed last.
        self._n_writes = 0
        self._n_writes_then: dict[Ticket, int] = {}
        self._hung: set[Ticket] = set()
        #: Lease lost, but not yet out of the executor.
        self._disowned: set[Ticket] = set()
        self._line = Backoff()
        self._idle = Backoff(PATIENCE_S, IDLE_S)
        self._downtime = Downtime("coordinator")
        self._heartbeat = Heartbeat(source, self._info, self.held, self._downtime)
        self._adopt()

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
            finally:
                self._leave()

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
        # Stop claiming while results cannot be reported.
        if n_free <= 0 or self._unreported or not (self._line.is_due() and self._idle.is_due()):
            return
        n_jobs = min(n_free, MOST_CLAIMED)
        request = ClaimRequest(worker=self._info(), n_jobs=n_jobs, campaign_id=self._campaign_id)
        try:
            answer = self._source.claim(request)
        except UnreachableError as error:
            self._wait(error)
            return
        self._heard()
        self._accept(answer)
        if len(answer.claims) < n_jobs:
            self._idle.failed()
        else:
            self._idle.succeeded()

    def _accept(self, answer: ClaimAnswer) -> None:
        self._heartbeat.period_s = answer.heartbeat_s
        for claim in answer.claims:
            ticket = claim.ticket
            self._running[ticket] = self._awake() + wall_limit_s(claim.job)
            self._digests[ticket] = job_digest(claim.job)
            self._executor.submit(ticket, claim.job)

    def _obey(self) -> None:
        for answer in self._heartbeat.answers():
            self._n_writes += bool(answer.extended)
            for job in answer.to_cancel:
                self._executor.cancel(job.ticket)
            for job in answer.not_held:
                self._disown(job.ticket)

    def _disown(self, ticket: Ticket) -> None:
        # A finished outcome is still reported: unless the job was claimed again, the source takes it.
        if ticket in self._running:
            self._disowned.add(ticket)
            self._executor.cancel(ticket, force=True)

    def _kill_hung(self) -> None:
        # A solve checks the clock itself; one that is still running here is stuck in code that does not.
        now = self._awake()
        for ticket, end in self._running.items():
            if now > end and ticket not in self._hung:
                self._hung.add(ticket)
                self._executor.cancel(ticket, force=True)

    def _collect(self) -> None:
        end = time.monotonic() + PATIENCE_S
        # Asked even if nothing runs: so an executor that is lost is noticed in time.
        done = self._executor.finished(PATIENCE_S)
        for ticket, part in self._executor.handed_in():
            before = self._parts.get(ticket)
            if before is not None:
                part = part._replace(solves=before.solves + part.solves)
            self._parts[ticket] = part
        for finished in done:
            self._take(finished)
        if not self._running and not (self._unreported and self._line.is_due()):
            # Nothing can finish, which some executors say at once.
            time.sleep(max(0.0, end - time.monotonic()))

    def _take(self, finished: Finished) -> None:
        ticket, outcome = finished.ticket, finished.outcome
        if ticket in self._hung and outcome.head.ending is Ending.CANCELLED:
            error = "job: expected an outcome in time, got none"
            outcome = Sealed(Ended(ending=Ending.TIMEOUT, error=error))
        if ticket not in self._disowned:
            self._unreported[ticket] = self._rest(ticket, outcome)
        else:
            self._digests.pop(ticket, None)
            self._parts.pop(ticket, None)
        self._next_hops.pop(ticket, None)
        self._running.pop(ticket, None)
        self._hung.discard(ticket)
        self._disowned.discard(ticket)

    def _rest(self, ticket: Ticket, outcome: Sealed[Ended]) -> Sealed[Ended]:
        """Return an outcome without the hops that are reported already."""
        if outcome.solves:
            # It has those that wait as well.
            self._parts.pop(ticket, None)
        first = self._next_hops.get(ticket, 0)
        return outcome._replace(solves=tuple(solve for solve in outcome.solves if solve.hop >= first))

    def _hand_in(self) -> None:
        """Report finished hops of running chains, so that the loss of a worker does not cost them."""
        for ticket, part in list(self._parts.items()):
            if not self._line.is_due():
                return
            try:
                self._source.hand_in(HandedIn(ticket, part))
            except (FaultyError, UnacceptableError, StaleAttemptError) as error:
                # The outcome has them all again, and tells what is wrong where that is refused too.
                log.warning("job %d: hops not handed in: %s", ticket.job_id, error, extra=_ids(ticket))
            except UnreachableError as error:
                self._wait(error)
                return
            else:
                self._next_hops[ticket] = part.head.place.next_hop
                self._heard()
            del self._parts[ticket]

    def _report(self) -> None:
        if not self._line.is_due():
            self._keep()
            return
        self._hand_in()
        if len(self._unreported) > 1 and self._line.is_due():
            self._report_many()
        for ticket in list(self._unreported):
            if not self._line.is_due():
                return
            try:
                self._send(ticket)
            except UnreachableError as error:
                self._wait(error)

    def _report_many(self) -> None:
        tickets = list(self._unreported)[:MOST_REPORTS]
        try:
            answers = self._source.complete_many([self._report_of(ticket) for ticket in tickets]).answers
        except (FaultyError, UnacceptableError, StaleAttemptError):
            # None was taken.  Sent one by one, they tell which of them it is.
            return
        except UnreachableError as error:
            self._wait(error)
        else:
            for ticket, answer in zip(tickets, answers, strict=True):
                self._accept_answer(ticket, answer)

    def _report_of(self, ticket: Ticket, has_digest: bool = False) -> Finished:
        digest = self._digests.get(ticket) if has_digest or ticket in self._adopted else None
        return Finished(ticket, self._unreported[ticket], digest)

    def _send(self, ticket: Ticket) -> None:
        try:
            answer = self._source.complete(self._report_of(ticket))
        except FaultyError as error:
            # The others first: whether they are taken shows whose fault it is.
            self._unreported[ticket] = self._unreported.pop(ticket)
            if self._is_given_up(ticket):
                self._replace(ticket, error)
            else:
                raise
        except UnacceptableError as error:
            self._replace(ticket, error)
        except StaleAttemptError as error:
            # Lease lost: another worker has the job.
            level = logging.WARNING if ticket in self._kept else logging.INFO
            log.log(level, "%s", error, extra=_ids(ticket))
            self._settle(ticket)
        else:
            self._accept_answer(ticket, answer)

    def _is_given_up(self, ticket: Ticket) -> bool:
        """Count a failed report, unless the source has not worked since the last one."""
        if self._n_writes_then.get(ticket) != self._n_writes:
            self._n_writes_then[ticket] = self._n_writes
            self._n_faults[ticket] += 1
        return self._n_faults[ticket] >= MOST_FAULTS

    def _accept_answer(self, ticket: Ticket, answer: CompleteAnswer) -> None:
        self._n_writes += 1
        is_result = self._unreported[ticket].head.ending in RESULTS
        if ticket in self._adopted and is_result and answer.state != "done":
            self._set_aside(ticket, f"expected an open job, got one that is {answer.state}; requeue it")
        if ticket in self._kept:
            log.warning("job %d: the outcome that waited is handed in", ticket.job_id, extra=_ids(ticket))
        self._settle(ticket)

    def _settle(self, ticket: Ticket) -> None:
        del self._unreported[ticket]
        self._digests.pop(ticket, None)
        self._n_faults.pop(ticket, None)
        self._n_writes_then.pop(ticket, None)
        self._adopted.discard(ticket)
        if ticket in self._kept and self._outbox is not None:
            self._kept.discard(ticket)
            self._outbox.remove(ticket)
        self._heard()
        self._idle.succeeded()

    def _replace(self, ticket: Ticket, error: SourceError) -> None:
        """Set a rejected outcome aside and report an error in its place, so that it shows."""
        text = "job %d: expected a report that is accepted, got %s"
        log.error(text, ticket.job_id, error, extra=_ids(ticket))
        where = self._set_aside(ticket, str(error)) if self._unreported[ticket].solves else ""
        if self._unreported[ticket].head.ending is Ending.ERROR or ticket in self._adopted:
            # Not even this, or a job of which we know nothing more: it comes back when its lease has run out.
            self._settle(ticket)
            return
        self._unreported[ticket] = Sealed(Ended(ending=Ending.ERROR, error=f"report: {error}{where}"))
        self._n_faults.pop(ticket, None)

    def _set_aside(self, ticket: Ticket, reason: str) -> str:
        """Save a rejected outcome for inspection; return a phrase that says where."""
        path = self._outbox and self._outbox.set_aside(self._report_of(ticket, has_digest=True))
        self._kept.discard(ticket)
        if path is None:
            return ""
        log.error("job %d: its outcome is kept in %s: %s", ticket.job_id, path, reason, extra=_ids(ticket))
        return f"; the outcome is kept in {path}"

    def _adopt(self) -> None:
        """Load the outcomes that an earlier dispatcher could not report."""
        for report in self._outbox.reports() if self._outbox is not None else ():
            ticket = report.ticket
            self._unreported[ticket] = report.outcome
            self._digests[ticket] = report.job_digest or ""
            self._kept.add(ticket)
            self._adopted.add(ticket)
        if self._adopted:
            log.warning("%d outcomes of an earlier dispatcher are handed in first", len(self._adopted))

    def _keep(self) -> None:
        """Save unreported outcomes to disk: this process may not live until the source is back."""
        if self._outbox is None:
            return
        for ticket, outcome in self._unreported.items():
            if not outcome.solves or ticket in self._kept:
                continue
            if self._outbox.put(self._report_of(ticket, has_digest=True)):
                self._kept.add(ticket)

    def _leave(self) -> None:
        self._keep()
        if self._kept and self._outbox is not None:
            text = "%d outcomes are not handed in; the next dispatcher offers them from %s"
            log.warning(text, len(self._kept), self._outbox.folder)

    def _heard(self) -> None:
        self._line.succeeded()
        self._downtime.end()

    def _wait(self, error: UnreachableError) -> None:
        self._line.failed(error.wait_s)
        self._keep()
        n = len(self._unreported)
        text = f"{error}; asked again until it works; outcomes that wait to be handed in: {n}"
        if self._outbox is not None and self._kept:
            text += f", {len(self._kept)} of them in {self._outbox.folder}"
        self._downtime.tell(text)

    def _drain(self) -> None:
        for force, patience_s in ((False, GRACE_S), (True, REPORT_S)):
            for ticket in self._running:
                self._executor.cancel(ticket, force)
            if force:
                # Whoever waits for this process may not wait until the coordinator answers.
                self._keep()
            deadline = time.monotonic() + patience_s
            while (self._running or (force and self._unreported)) and time.monotonic() < deadline:
                self._collect()
                self._report()

    def _lose_all(self, reason: str) -> None:
        for ticket in list(self._running):
            self._take(Finished(ticket, Sealed(Ended(ending=Ending.LOST, error=reason))))
        deadline = time.monotonic() + REPORT_S
        while self._unreported and time.monotonic() < deadline:
            self._report()
            time.sleep(0.0 if self._line.is_due() else PATIENCE_S)


def _ids(ticket: Ticket) -> dict[str, int]:
    return {"job": ticket.job_id, "attempt": ticket.attempt}
