"""Executors: the protocol of everything that runs jobs; inline in this process, or a pool of processes.

An executor may lose all it holds at any time; the coordinator's database is the only truth.  The pool has one
process per slot, each with its own pipe: `concurrent.futures` would lose its whole pool when one child is
killed; here a killed child is one attempt that ended as `crash`, and its slot starts again.

    ExecutorError(RuntimeError)   asked for what it cannot do
        ExecutorLostError         it no longer answers; a new one must be started
"""

import json
import os
import queue
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from core.errors import UserError
from workers.messages import (
    Claim,
    Ended,
    Ending,
    Finished,
    HandedIn,
    Job,
    JobOutcome,
    Reached,
    Sealed,
    Ticket,
    WorkerError,
    sealed,
    unpacked,
)
from workers.process_tree import single_threaded

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


#: How long a child may take to leave after its stdin closed [s].
LEAVE_SECONDS = 2.0
#: How much of what a child printed is kept as the explanation of a crash.
CAPTURED_BYTES = 4000


class _Child:
    """One process, the ticket it works on, and a thread that reads its replies."""

    def __init__(self, runner: str, replies: "queue.Queue[tuple[_Child, str | None]]") -> None:
        self.ticket: Ticket | None = None
        self.is_killed = False
        #: When to kill it, if it was asked to stop and does not.
        self.patience_ends: float | None = None
        self._printed = tempfile.TemporaryFile()
        self.process = subprocess.Popen(
            # -P: a folder called `core` where the user happens to stand must not be imported.
            [sys.executable, "-P", "-m", "workers.child", runner],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._printed,
            text=True,
            encoding="utf-8",
            env=single_threaded(os.environ) | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            # Ctrl-C in the terminal is the parent's business alone.
            start_new_session=True,
        )
        self._replies = replies
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def send(self, order: dict[str, Any]) -> None:
        """Send a request; a child that just died is noticed by its reader."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(json.dumps(order) + "\n")
            self.process.stdin.flush()
        except (BrokenPipeError, OSError):
            return

    def kill(self) -> None:
        """End the process at once."""
        self.is_killed = True
        self.process.kill()

    def crash_outcome(self) -> Ended:
        """Return how the job of a process that died ended: killed by us, or by something else."""
        if self.is_killed:
            return Ended(ending=Ending.CANCELLED)
        return Ended(ending=Ending.CRASH, error=self._stderr())

    def _stderr(self) -> str:
        self._printed.seek(0, os.SEEK_END)
        self._printed.seek(max(0, self._printed.tell() - CAPTURED_BYTES))
        printed = self._printed.read().decode(errors="replace").strip()
        return f"worker process: expected a reply, got exit code {self.process.wait()}\n{printed}".strip()

    def dismiss(self) -> None:
        """Ask the process to exit."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.close()
        except OSError:
            pass  # A child that died first leaves unflushed orders behind.

    def leave(self) -> None:
        """Stop the process, gracefully if possible, and close its pipes."""
        assert self.process.stdout is not None
        self.dismiss()
        try:
            self.process.wait(LEAVE_SECONDS)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._reader.join()
        self.process.stdout.close()
        self._printed.close()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            # A process killed while it writes leaves half a line.
            if line.endswith("\n"):
                self._replies.put((self, line))
        self._replies.put((self, None))


class ProcessPool:
    """An executor of `n_workers` processes; `runner` names the function they call."""

    def __init__(
        self, n_workers: int, runner: str = "workers.run:run_job", grace_s: float = CANCEL_GRACE_S
    ) -> None:
        if n_workers < 1:
            raise ExecutorError(f"workers: expected at least 1, got {n_workers}")
        self._runner = runner
        self._grace_s = grace_s
        self._replies: queue.Queue[tuple[_Child, str | None]] = queue.Queue()
        self._parts: list[HandedIn] = []
        self._children = [self._start_child() for _ in range(n_workers)]

    def capacity(self) -> int:
        """Return the number of processes."""
        return len(self._children)

    def processes(self) -> dict[int, Ticket | None]:
        """Return the process ids and what each works on."""
        return {child.process.pid: child.ticket for child in self._children}

    def submit(self, ticket: Ticket, job: Job) -> None:
        """Hand a job to an idle process."""
        child = next((child for child in self._children if child.ticket is None), None)
        if child is None:
            n = self.capacity()
            raise ExecutorError(
                f"process pool: expected at most {n} jobs at a time, got job {ticket.job_id} too"
            )
        child.ticket = ticket
        child.send({"run": Claim(**ticket._asdict(), job=job).model_dump(mode="json")})

    def finished(self, timeout: float) -> list[Finished]:
        """Return what has ended, after waiting at most `timeout` seconds for a first one."""
        self._kill_overdue()
        done = []
        for child, line in self._replies_within(timeout):
            reply = {} if line is None else json.loads(line)
            if "part" in reply:
                self._parts.append(HandedIn(Ticket(*reply["ticket"]), unpacked(Reached, reply["part"])))
                continue
            ticket, child.ticket, child.patience_ends = child.ticket, None, None
            if line is None:
                if ticket is not None:
                    done.append(Finished(ticket, Sealed(child.crash_outcome())))
            else:
                done.append(Finished(Ticket(*reply["ticket"]), unpacked(Ended, reply["outcome"])))
            if line is None or child.is_killed:
                # Killed after its reply, it would take the next job with it.
                self._restart(child)
        return done

    def handed_in(self) -> list[HandedIn]:
        """Return what children have handed in of chains that go on."""
        parts, self._parts = self._parts, []
        return parts

    def cancel(self, ticket: Ticket, force: bool = False) -> None:
        """Ask the attempt to stop at its next iteration and kill it after a grace, or kill it now."""
        for child in self._children:
            if child.ticket == ticket:
                if force:
                    child.kill()
                elif child.patience_ends is None:
                    child.patience_ends = time.monotonic() + self._grace_s
                    child.send({"cancel": list(ticket)})

    def close(self) -> None:
        """Stop all processes, in parallel."""
        for child in self._children:
            child.dismiss()
        for child in self._children:
            child.leave()
        self._children = []

    def _kill_overdue(self) -> None:
        for child in self._children:
            if child.patience_ends is not None and time.monotonic() > child.patience_ends:
                child.kill()

    def _start_child(self) -> _Child:
        return _Child(self._runner, self._replies)

    def _restart(self, child: _Child) -> None:
        if child in self._children:
            child.leave()
            self._children[self._children.index(child)] = self._start_child()

    def _replies_within(self, timeout: float) -> Iterator[tuple[_Child, str | None]]:
        try:
            yield self._replies.get(timeout=timeout)
            while True:
                yield self._replies.get_nowait()
        except queue.Empty:
            return
