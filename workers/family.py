"""The processes below this one: all of them end where nothing can be ended in peace."""

from collections.abc import Iterable

import psutil


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
