"""What runs inside a Ray worker process: one attempt at one job, from JSON text to JSON text.

Nothing heavy is imported before the threads of numerical libraries are limited, and nothing of Ray at all:
the executor makes tasks of these functions.  A worker process is used again for the next job, so kernels and
compiled code are loaded once.
"""

import json
import os
import platform
import signal
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib.metadata import version
from typing import Any, NamedTuple

from workers.child import runner_named
from workers.job import Claim, JobOutcome
from workers.threads import require_one_thread, single_threaded


class Versions(NamedTuple):
    """What must be the same at both ends of a cluster, or results would depend on where a job ran."""

    python: str
    ray: str
    code: str


class ForeignWorker(RuntimeError):
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
    """Show that there is still somebody who runs tasks."""


def execute(runner: str, claim: str, expected: tuple[str, ...]) -> bytes:
    """Run the job of a claim and return its outcome, both as JSON, the latter compressed."""
    with _stop_flag() as stop:
        _limit_threads()
        if tuple(versions()) != tuple(expected):
            raise ForeignWorker(f"worker on {platform.node()}: {difference(expected, versions())}")
        outcome = runner_named(runner)(Claim.model_validate_json(claim).job, stop)
    return packed(outcome)


def difference(expected: tuple[str, ...], found: tuple[str, ...]) -> str:
    """Return in words what two versions differ in."""
    pairs = zip(Versions._fields, expected, found, strict=True)
    return "; ".join(f"expected {name} {wanted}, got {got}" for name, wanted, got in pairs if wanted != got)


def packed(outcome: JobOutcome) -> bytes:
    """Return an outcome small enough for Ray to carry it in its reply, where it has up to a dozen solves."""
    return zlib.compress(json.dumps(outcome.model_dump(mode="json")).encode())


def unpacked(reply: bytes) -> JobOutcome:
    """Return the outcome that was packed."""
    return JobOutcome.model_validate(json.loads(zlib.decompress(reply)))


def _limit_threads() -> None:
    # Ray sets OMP_NUM_THREADS alone; a worker has not imported numpy before its first job.
    os.environ.update(single_threaded({}))


@contextmanager
def _stop_flag() -> Iterator[Callable[[], bool]]:
    """Give the function that says whether Ray was asked to cancel this task.

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
