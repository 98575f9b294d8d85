"""Writes output files atomically, and never over an existing one.

FileError(RuntimeError)   a file that cannot be written where it was asked for
"""

import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from core.errors import UserError


class FileError(UserError, RuntimeError):
    """A file that cannot be written where it was asked for."""


def write_new(path: Path, content: Iterable[bytes]) -> int:
    """Write a file that does not exist yet; return its size in bytes."""
    if path.exists():
        raise FileError(f"file {path}: expected a new file, got one that exists; name another with --output")
    try:
        descriptor, draft = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
    except OSError as error:
        raise FileError(
            f"file {path}: expected a folder to write to, got {error.strerror}; name another with --output"
        ) from error
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.writelines(content)
            n_bytes = stream.tell()
        # A draft is for nobody else to read; the file is as readable as any new one.
        os.chmod(draft, 0o666 & ~_umask())
        os.replace(draft, path)
    except OSError as error:
        raise FileError(f"file {path}: expected room to write, got {error.strerror}") from error
    finally:
        Path(draft).unlink(missing_ok=True)
    return n_bytes


def require_folder(folder: Path) -> None:
    """Make the folder that results will go to, or refuse it before the work rather than after."""
    reason = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror
    if reason or not os.access(folder, os.W_OK):
        reason = reason or "one that is not yours"
        raise FileError(f"folder {folder}: expected one to write in, got {reason}; name another with --out")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
