"""What runs on the nodes of a Ray cluster: the task itself, the cluster's folder and token, and a watchdog.

A task is one attempt at one job, from JSON text to JSON text.  Nothing heavy is imported before the threads
of numerical libraries are limited, and nothing of Ray at all: the executor makes tasks of these functions.  A
worker process is used again for the next job, so kernels and compiled code are loaded once.

The folder of a cluster that is started here holds sockets and logs, below the system's temporary folder.  A
dispatcher that is killed leaves it behind; the next one removes it: a lock, which the kernel releases with
the process that held it, tells whose folders are in use.  Whoever has the token of a cluster can run anything
on its machines; Ray itself writes it readable for all users, so the file is ours and its mode is checked.
The watchdog notices a cluster that no longer runs tasks; without it a dispatcher would hang with its jobs.
"""

import faulthandler
import fcntl
import json
import os
import platform
import secrets
import shutil
import signal
import stat
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator, MutableMapping
from contextlib import contextmanager
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from platformdirs import user_data_path

from workers.child import runner_named
from workers.executor import ExecutorError, ExecutorLostError
from workers.messages import Claim, Ended, JobOutcome, WorkerError, packed, sealed
from workers.process_tree import require_one_thread, single_threaded


class Versions(NamedTuple):
    """What must be the same at both ends of a cluster, or results would depend on where a job ran."""

    python: str
    ray: str
    code: str


class ForeignWorkerError(WorkerError):
    """A worker process of another version than the dispatcher that sent it a job."""


@cache
def versions() -> Versions:
    """Return the versions of this process."""
    from workers.provenance import code_version

    return Versions(".".join(platform.python_version_tuple()[:2]), version("ray"), code_version())


def probe() -> tuple[str, ...]:
    """Return the versions of this worker process, once its numerical libraries run one thread each."""
    _limit_threads()
    found = versions()
    require_one_thread()
    return tuple(found)


def answer() -> None:
    """Show that tasks are still run."""


def execute(runner: str, claim: str, expected: tuple[str, ...]) -> bytes:
    """Run the job of a claim and return its outcome, both as JSON, the latter compressed."""
    with _stop_flag() as stop:
        _limit_threads()
        if tuple(versions()) != tuple(expected):
            raise ForeignWorkerError(f"worker on {platform.node()}: {difference(expected, versions())}")
        outcome = runner_named(runner)(Claim.model_validate_json(claim).job, stop)
    return compress(outcome)


def compress(outcome: JobOutcome) -> bytes:
    """Return an outcome small enough for Ray to carry it in its reply, where it has up to a dozen solves."""
    return zlib.compress(json.dumps(packed(sealed(Ended, outcome))).encode())


def difference(expected: tuple[str, ...], found: tuple[str, ...]) -> str:
    """Return in words what two versions differ in."""
    pairs = zip(Versions._fields, expected, found, strict=True)
    return "; ".join(f"expected {name} {wanted}, got {got}" for name, wanted, got in pairs if wanted != got)


def _limit_threads() -> None:
    # Ray sets OMP_NUM_THREADS alone; a worker has not imported numpy before its first job.
    os.environ.update(single_threaded({}))


@contextmanager
def _stop_flag() -> Iterator[Callable[[], bool]]:
    """Yield the function that tells whether this task was cancelled.

    Ray cancels by interrupting the main thread.  Taken as a flag, the interrupt cannot hit an import or a
    compilation in the middle, and a solve hands in what it finished before.
    """
    asked: list[int] = []

    def ask(number: int, _frame: Any) -> None:
        asked.append(number)

    before = signal.signal(signal.SIGINT, ask)
    try:
        yield lambda: bool(asked)
    finally:
        signal.signal(signal.SIGINT, before)


PREFIX = "coastarc-ray-"
#: Socket paths are at most 107 bytes, of which Ray's names below the folder take 64.
LONGEST_FOLDER = 43
#: A younger folder may not be locked yet [s].
SETTLED_S = 60.0


class RayFolder:
    """A folder that lasts until it is closed, or until the next one is made after its process died."""

    def __init__(self) -> None:
        _sweep(Path(tempfile.gettempdir()))
        self.path = Path(tempfile.mkdtemp(prefix=PREFIX)).absolute()
        self._lock = _lock_of(self.path)
        fcntl.flock(self._lock, fcntl.LOCK_EX)

    def close(self) -> None:
        """Delete it."""
        shutil.rmtree(self.path, ignore_errors=True)
        os.close(self._lock)


def require_short(folder: Path) -> Path:
    """Return a folder below which Ray's sockets have room."""
    folder = folder.absolute()
    if len(os.fsencode(folder)) > LONGEST_FOLDER:
        raise ExecutorError(
            f"ray folder: expected a path of at most {LONGEST_FOLDER} bytes for sockets, got {folder}; "
            "choose a shorter one, or a shorter TMPDIR"
        )
    return folder


def _lock_of(folder: Path) -> int:
    return os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o600)


def _sweep(parent: Path) -> None:
    for folder in parent.glob(f"{PREFIX}*"):
        try:
            about = folder.stat()
            if about.st_uid != os.getuid() or time.time() - about.st_mtime < SETTLED_S:
                continue
            lock = _lock_of(folder)
        except OSError:
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(folder, ignore_errors=True)
        except OSError:
            pass  # Somebody works in it.
        finally:
            os.close(lock)


def own_token(path: Path | None = None) -> Path:
    """Return the file with the token of clusters started here; it is made where there is none."""
    path = path or user_data_path("coastarc") / "ray.token"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        draft = path.with_name(f"{path.name}.{os.getpid()}")
        with open(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(secrets.token_hex(32))
        try:
            # Unlike a rename, a link never replaces the token that another process wrote meanwhile.
            os.link(draft, path)
        except FileExistsError:
            pass
        finally:
            draft.unlink()
    return checked(path)


def checked(path: Path) -> Path:
    """Return a token file that nobody else can read."""
    if not path.is_file():
        raise ExecutorError(f"ray token: expected a file with the cluster's token, got {path}")
    mode = stat.S_IMODE(path.stat().st_mode)
    if mode & 0o077:
        raise ExecutorError(f"ray token {path}: expected mode 0600, got {mode:04o}; chmod 600 it")
    return path


def require_token(environment: MutableMapping[str, str], path: Path | None) -> None:
    """Set what makes Ray authenticate; read when Ray is imported and handed on to what it starts."""
    environment["RAY_AUTH_MODE"] = "token"
    if path is not None:
        # A token in the environment would win over the file.
        environment.pop("RAY_AUTH_TOKEN", None)
        # Absolute, since Ray's processes stand elsewhere.
        environment["RAY_AUTH_TOKEN_PATH"] = str(path.absolute())


@contextmanager
def ended_after(seconds: float) -> Iterator[None]:
    """End this process, with exit code 1, if the block takes longer, even if no thread of ours can run.

    Ray holds the interpreter while it waits for its raylet, which replies to a driver once its first workers
    have registered; if one of them is killed while it starts, that is never.
    """
    faulthandler.dump_traceback_later(seconds, exit=True, file=sys.__stderr__ or sys.stderr)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


class Watchdog:
    """Probes the cluster with empty tasks, since calls block for ever once its raylet is dead."""

    def __init__(self, ray: Any, interval_s: float = 5.0, timeout_s: float = 10.0) -> None:
        self._ray = ray
        self._task = self._ray.remote(num_cpus=0, max_retries=0)(answer)
        self._interval_s = interval_s
        self._timeout_s = timeout_s
        self._next = time.monotonic() + interval_s
        self._asked: tuple[Any, float] | None = None
        self._n_missed = 0

    def look(self) -> None:
        """Send a probe or check its answer; raise ExecutorLostError after two in a row without one."""
        now = time.monotonic()
        if self._asked is None:
            if now >= self._next:
                self._asked = (self._task.remote(), now)
            return
        reference, since = self._asked
        if self._ray.wait([reference], timeout=0)[0]:
            self._asked, self._next = None, now + self._interval_s
            self._count(self._is_answer(reference))
        elif now - since > self._timeout_s:
            self._asked, self._next = None, now
            self._count(False)

    def _is_answer(self, reference: Any) -> bool:
        try:
            self._ray.get(reference, timeout=self._timeout_s)
        except self._ray.exceptions.RayError:
            # Its process may have been killed, as that of any job; once the raylet is dead, and the cluster
            # has noticed, every answer is an error.
            return False
        return True

    def _count(self, is_answer: bool) -> None:
        self._n_missed = 0 if is_answer else self._n_missed + 1
        if self._n_missed == 2:
            raise ExecutorLostError(
                f"ray cluster: expected an answer in {self._timeout_s:g} s, got none or an error, twice; "
                "start the dispatcher again"
            )
