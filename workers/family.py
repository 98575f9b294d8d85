"""The processes below this one: all of them end where nothing can be ended in peace."""

import ctypes
import sys
from collections.abc import Iterable

import psutil

_PR_SET_CHILD_SUBREAPER = 36


def adopt_orphans() -> None:
    """Become the parent of what those below this process leave behind when they are killed.

    Else nobody could tell any more whose they were.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def kill(processes: Iterable[psutil.Process]) -> None:
    """Kill processes, those that are gone already excepted; nobody is waited for."""
    for process in processes:
        try:
            process.kill()
        except psutil.NoSuchProcess:
            continue


def kill_descendants() -> None:
    """Kill every child of this process and theirs."""
    kill(psutil.Process().children(recursive=True))
