"""The folder of a Ray cluster that is started here: sockets and logs, below the system's temporary folder.

A dispatcher that is killed leaves its folder behind.  The next one takes it away: a lock, which the kernel
gives back with the process that held it, tells whose folders are still needed.
"""

import fcntl
import os
import shutil
import tempfile
import time
from pathlib import Path

from workers.executor import ExecutorError

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
