"""The cache folder for compiled kernels and generated orbits.

Files are checked by a digest: one that is truncated, altered or without its digest is made again.  Every
process writes the same bytes, so that several may do it at once.

    CacheError(UserError, RuntimeError)   there is no folder to write to
"""

import functools
import hashlib
import os
import stat
import tempfile
from pathlib import Path

from platformdirs import user_cache_path

from core.errors import UserError

_REMEDY = "make it writable, or set XDG_CACHE_HOME to a folder that is"


class CacheError(UserError, RuntimeError):
    """There is no folder to write to; the message says which were tried."""


def cache_folder() -> Path:
    """Return the user's cache folder of coastarc or, where that cannot be written, a temporary one."""
    return _choose_folder()[0]


def cache_note() -> str:
    """Return in one line why the user's cache folder is not used, or an empty text where it is."""
    return _choose_folder()[1]


@functools.cache
def _choose_folder() -> tuple[Path, str]:
    wanted = user_cache_path("coastarc")
    reason = _fault_of(wanted)
    if not reason:
        return wanted, ""
    problem = f"cache folder {wanted}: expected one that can be written, got {reason}"
    try:
        instead = Path(tempfile.gettempdir()) / f"coastarc-{os.getuid()}"
    except FileNotFoundError:
        raise CacheError(f"{problem}, and no folder for temporary files; {_REMEDY}") from None
    # Machine code is loaded from it, so no other user may own it.
    if fault := _fault_of(instead, is_shared=True):
        raise CacheError(f"{problem}, and for {instead} {fault}; {_REMEDY}")
    return instead, f"{problem}; using {instead}, which may be emptied; {_REMEDY}"


def _fault_of(folder: Path, is_shared: bool = False) -> str:
    """Return why a folder, created if absent, cannot be used, or an empty text."""
    if not folder.is_absolute():
        return "no home"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        facts = folder.lstat()
    except OSError as error:
        return error.strerror or type(error).__name__
    is_own = stat.S_ISDIR(facts.st_mode) and facts.st_uid == os.getuid() and not facts.st_mode & 0o022
    if is_shared and not is_own:
        return "a folder that others can write"
    return "" if os.access(folder, os.W_OK | os.X_OK) else "no permission to write"


def seal(path: Path) -> None:
    """Write the digest of a file beside it, atomically.

    Parameters
    ----------
    path : Path
        A file that is complete.
    """
    descriptor, draft = tempfile.mkstemp(dir=path.parent, prefix=".writing-")
    with os.fdopen(descriptor, "w", encoding="ascii") as stream:
        stream.write(_digest(path))
    os.replace(draft, _beside(path))


def is_sealed(path: Path) -> bool:
    """Return whether a file is there, and has the digest that `seal` wrote beside it.

    Parameters
    ----------
    path : Path
        A file that may be absent or damaged.
    """
    try:
        facts = path.stat()
        return _beside(path).read_bytes() == _known_digest(
            path, facts.st_ino, facts.st_mtime_ns, facts.st_size
        )
    except OSError:
        return False


@functools.lru_cache(maxsize=64)
def _known_digest(path: Path, inode: int, changed_ns: int, n_bytes: int) -> bytes:
    return _digest(path).encode()


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, lambda: hashlib.blake2b(digest_size=16)).hexdigest()


def _beside(path: Path) -> Path:
    return path.with_name(f"{path.name}.blake2b")
