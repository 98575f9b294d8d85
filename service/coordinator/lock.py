"""The lock that admits one coordinator per data folder.

The lock belongs to the open file, so the operating system gives it back when the process dies.  The file says
whose process has the folder, and the folder's own name, by which several coordinators on one database are
told apart: hosts and paths may be the same on two machines.
"""

import errno
import os
import secrets
from pathlib import Path
from typing import Self

from core.errors import UserError


class LockError(UserError, RuntimeError):
    """A data folder that another coordinator holds, or that cannot be locked."""


class FolderLock:
    """Holds a data folder from `with` to its end."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._descriptor = -1
        #: Drawn when the folder is taken for the first time, and the same ever after.
        self.folder_id = ""

    def __enter__(self) -> Self:
        """Take the folder, or raise."""
        try:
            self._descriptor = os.open(self._folder / "coordinator.lock", os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:
            raise LockError(
                f"data folder {self._folder}: expected one to write in, got {error.strerror}; "
                f"name another folder with --data"
            ) from error
        has_taken = _take(self._descriptor)
        owner, self.folder_id = _read(self._descriptor)
        if not has_taken:
            os.close(self._descriptor)
            raise LockError(
                f"data folder {self._folder}: expected to be free, got one in use by process {owner}; "
                f"stop it, or name another folder with --data"
            )
        try:
            _write(self._descriptor, self.folder_id)
        except OSError as error:
            os.close(self._descriptor)
            what, remedy = ("one to write in", "look at the disk")
            if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
                what, remedy = "room to write", "free some space and start again"
            raise LockError(
                f"data folder {self._folder}: expected {what}, got {error.strerror}; {remedy}"
            ) from error
        return self

    def __exit__(self, *_: object) -> None:
        """Give the folder back; the file stays, since removing it would race with the next owner."""
        os.close(self._descriptor)


def openness(folder: Path) -> str | None:
    """Return what is wrong with a data folder that others may look into, with the remedy."""
    mode = folder.stat().st_mode & 0o777
    if os.name == "nt" or not mode & 0o077:
        return None
    return f"data folder {folder}: expected mode 0700, got {mode:04o}; chmod 700 it"


def _read(descriptor: int) -> tuple[str, str]:
    """Return whose process has, or had, the folder, and its id: a new one where it has none."""
    words = os.read(descriptor, 64).decode("ascii", "replace").split()
    return words[0] if words else "unknown", words[1] if len(words) > 1 else secrets.token_hex(8)


def _write(descriptor: int, folder_id: str) -> None:
    text = f"{os.getpid()} {folder_id}".encode()
    # Written over before it is cut: a full disk then leaves what was there.
    os.lseek(descriptor, 0, os.SEEK_SET)
    os.write(descriptor, text)
    os.ftruncate(descriptor, len(text))


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
