"""Runs a dispatcher as a child process and restarts it.

The child may die at any time, and Ray makes it die now and then: its jobs come back through their leases, and
another child is started.  It is told what to do, and to stop, through a pipe, so that it ends by itself when
the coordinator is killed and nobody can tell it anything any more.  What keeps a child from being started may
pass too, as a full disk does: then that is tried again, for as long as it takes.
"""

import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable

from core.errors import UserError
from service.db.errors import DatabaseError
from workers.dispatch import CANNOT_WORK, NEW_TOKEN, TOKEN_WANTED, DispatchOrder
from workers.retry import Backoff

log = logging.getLogger(__name__)

#: Pauses before a child is started again; the first is short, since jobs wait for it [s].
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 30.0
#: A child that has lived so long was well: the next pause is short again [s].
WELL_S = 60.0
#: How long a child may take to stop solves and to report them before it is killed; what it has not reported
#: by then is in its outbox [s].
LEAVE_S = 3.5


class Supervisor:
    """Restarts the child whenever it ends."""

    def __init__(self, order: Callable[[], DispatchOrder], leave_s: float = LEAVE_S) -> None:
        self._order = order
        self._leave_s = leave_s
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._child: subprocess.Popen[str] | None = None
        self._fault: str | None = None
        self._trouble: str | None = None
        self._backoff = Backoff(FIRST_PAUSE_S, LONGEST_PAUSE_S)
        self._thread = threading.Thread(target=self._run, name="supervisor", daemon=True)

    @property
    def pid(self) -> int | None:
        """The process id of the child, if one runs."""
        child = self._child
        return child.pid if child is not None and child.returncode is None else None

    @property
    def fault(self) -> str | None:
        """Why no child can work, if that is so."""
        return self._fault

    @property
    def trouble(self) -> str | None:
        """Why there is no child now, in words for everybody; another start is tried by itself."""
        return self._trouble

    def start(self) -> None:
        """Start a child, and another whenever it dies."""
        self._thread.start()

    def stop(self) -> None:
        """Let the child report what it has, and stop it."""
        with self._lock:
            self._stop.set()
            child = self._child
            if child is not None:
                _tell(child, "stop\n")
        if child is not None:
            self._thread.join(self._leave_s)
            if self._thread.is_alive():
                text = "dispatcher: expected to stop in %.1f s, got none; it is killed"
                log.warning(text, self._leave_s)
                child.kill()
        self._thread.join()

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self._start_child()
                if self._child is not None:
                    self._watch()
            except Exception as error:
                self._put_off(error)

    def _start_child(self) -> None:
        """Start a child, unless a stop was requested."""
        self._child = None
        order = self._order()
        with self._lock:
            if self._stop.is_set():
                return
            self._child = _spawn()
            _tell(self._child, order.written() + "\n")
        if self._trouble is not None:
            log.warning("dispatcher: started again")
        self._trouble = None

    def _put_off(self, error: Exception) -> None:
        """Wait until a start is worth trying again: a disk gets room, and a process memory, some day."""
        if self._child is not None and self._child.poll() is None:
            # Never two at once.
            _reap_child(self._child, is_alive=True)
        trouble, pause_s = _in_public(error), self._backoff.failed()
        if trouble != self._trouble:
            # Once, however long it lasts: lines without end would fill the disk that is full.
            reason = str(error) if isinstance(error, UserError) else repr(error)
            log.error("dispatcher: expected to start, got %s; tried again until it does", reason)
        self._trouble = trouble
        self._stop.wait(pause_s)

    def _watch(self) -> None:
        """Wait for the end of the child, and for the time to start another."""
        begin = time.monotonic()
        code, said = self._wait()
        if self._stop.is_set():
            return
        if code == CANNOT_WORK:
            self._fault = said
            self._stop.set()
            return
        if time.monotonic() - begin > WELL_S:
            self._backoff.succeeded()
        pause_s = self._backoff.failed()
        reason = said or f"exit code {code}"
        log.warning("dispatcher: expected to run, got %s; started again in %.1f s", reason, pause_s)
        self._stop.wait(pause_s)

    def _renew_token(self) -> None:
        """Send the child a new token in place of a refused one; its solves go on."""
        try:
            token = self._order().token
        except Exception as error:
            # It asks again.
            log.warning("dispatcher: expected a new token for it, got %r", error)
            return
        log.warning("dispatcher: expected a token in force, got one that is refused; it has another now")
        with self._lock:
            if self._child is not None and token is not None:
                _tell(self._child, f"{NEW_TOKEN}{token.get_secret_value()}\n")

    def _wait(self) -> tuple[int, str]:
        """Return how the child ended, and the last line that it said."""
        assert self._child is not None and self._child.stdout is not None and self._child.stdin is not None
        said = ""
        for line in self._child.stdout:
            if line.strip() == TOKEN_WANTED:
                self._renew_token()
            else:
                said = line.strip() or said
        code = _reap_child(self._child)
        self._child.stdout.close()
        try:
            self._child.stdin.close()
        except OSError:
            pass  # It died with an order unread.
        return code, said


def _in_public(error: Exception) -> str:
    """Return a reason without the path of the archive, which not every client may see."""
    if isinstance(error, DatabaseError):
        return "an archive that takes no write"
    strerror = error.strerror if isinstance(error, OSError) else None
    return strerror or type(error).__name__


def _spawn() -> subprocess.Popen[str]:
    return subprocess.Popen(
        # -P: a folder called `core` where the user happens to stand must not be imported.
        [sys.executable, "-P", "-m", "workers.dispatch"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        # Whatever a library prints must not end the thread that reads it.
        errors="replace",
        env=dict(os.environ) | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        # Ctrl-C in the terminal is ours alone: we then tell the child.
        start_new_session=True,
    )


def _reap_child(child: subprocess.Popen[str], *, is_alive: bool = False) -> int:
    """Wait for a child, and end what it left behind: all in its session, which it was the first of."""
    if not is_alive:
        os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)
    try:
        # Not reaped yet, so its process id is not reused.
        os.killpg(child.pid, signal.SIGKILL)
    except OSError:
        pass  # Nothing is left.
    return child.wait()


def _tell(child: subprocess.Popen[str], line: str) -> None:
    assert child.stdin is not None
    try:
        child.stdin.write(line)
        child.stdin.flush()
    except (OSError, ValueError):
        return  # A child that just died is noticed where it is waited for.
