"""One coordinator per data folder, however it is started.

The lock belongs to the open file, so the operating system gives it back when the process dies.
"""

import os
from pathlib import Path
from typing import Self

from core.faults import UserError


class LockError(UserError, RuntimeError):
    """A data folder in which another coordinator works, or nobody can."""


class FolderLock:
    """Holds a data folder from `with` to its end."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._descriptor = -1

    def __enter__(self) -> Self:
        """Take the folder, or raise."""
        try:
            self._descriptor = os.open(self._folder / "coordinator.lock", os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:
            raise LockError(
                f"data folder {self._folder}: expected one to write in, got {error.strerror}; "
                f"name another folder with --data"
            ) from error
        if not _take(self._descriptor):
            owner = os.read(self._descriptor, 32).decode().strip() or "unknown"
            os.close(self._descriptor)
            raise LockError(
                f"data folder {self._folder}: expected to be free, got one in use by process {owner}; "
                f"stop it, or name another folder with --data"
            )
        os.ftruncate(self._descriptor, 0)
        os.write(self._descriptor, str(os.getpid()).encode())
        return self

    def __exit__(self, *_: object) -> None:
        """Give the folder back; the file stays, since removing it would race with the next owner."""
        os.close(self._descriptor)


def _take(descriptor: int) -> bool:
    if os.name == "nt":
        import msvcrt

        try:
            # Beyond the text, which others must be able to read.
            os.lseek(descriptor, 1 << 20, os.SEEK_SET)
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
            os.lseek(descriptor, 0, os.SEEK_SET)
        except OSError:
            return False
        return True
    import fcntl

    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
