"""Compilation of the kernels with numba, and the cache of their machine code.

Numba detects a change in the file of a kernel, but not in a file that the kernel calls into.  So the name of
the cache folder has a hash of all sources that a kernel can use, those from transcription downwards: stale
machine code is never used.  It also has a hash of their path: numba compares the times of the files too, and
two copies of coastarc would invalidate each other's kernels.  Each file of the cache ends with a digest,
without which numba would load and run damaged content.
"""

import hashlib
import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core.caching import IndexDataCacheFile

from core.cache import cache_folder

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


#: Folders of kernels and of what they import; imports point down, so nothing above is compiled.
KERNEL_FOLDERS = ("", "ephemeris", "orbits", "dynamics", "transcription")


def _sources_digest() -> str:
    place = Path(__file__).parent
    digest = hashlib.blake2b(f"{numba.__version__} {place}".encode(), digest_size=8)
    for folder in KERNEL_FOLDERS:
        for path in sorted((place / folder).glob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


#: Where the machine code of this code is kept.
COMPILED_FOLDER = cache_folder() / f"compiled-{_sources_digest()}"


class _SealedFiles(IndexDataCacheFile):
    """The index and the machine code of one kernel; a file that is cut off or altered counts as absent."""

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:
        with super()._open_for_write(filepath) as stream:
            content = io.BytesIO()
            yield content
            # Numba reads pickles, which ignore trailing bytes.
            stream.write(content.getvalue() + _seal(content.getvalue()))

    def _load_index(self) -> dict[Any, str]:
        load: Any = super()._load_index
        found: dict[Any, str] = load() if _is_whole(self._index_path) else {}
        return found

    def _load_data(self, name: str) -> Any:
        load: Any = super()._load_data
        if not _is_whole(Path(self._cache_path) / name):
            raise OSError(f"kernel {name}: expected it with its digest, got another file")
        return load(name)


_SEAL_BYTES = 16


def _seal(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_SEAL_BYTES).digest()


def _is_whole(path: str | Path) -> bool:
    try:
        content = Path(path).read_bytes()
    except OSError:
        return False
    return content[-_SEAL_BYTES:] == _seal(content[:-_SEAL_BYTES])


@contextmanager
def _cached_here() -> Iterator[None]:
    """Let numba, which asks a global of its own where to keep a kernel, choose our folder meanwhile."""
    settings: Any = numba.config
    elsewhere, settings.CACHE_DIR = settings.CACHE_DIR, str(COMPILED_FOLDER)
    try:
        yield
    finally:
        settings.CACHE_DIR = elsewhere


def compiled(kernel: Kernel) -> Kernel:
    """Compile a kernel ahead of its first call per signature, cached on disk.

    Division by zero gives infinities, as in NumPy: a bad guess must end in a status, not an exception.
    The arithmetic is strictly IEEE.  With fused multiply-adds the compiler rounds a function differently in
    each place that it is inlined, and then a process that compiles and one that loads disagree.
    """
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        # As when building the documentation: a kernel is then the plain Python function.
        return kernel
    with _cached_here():
        dispatcher: Any = numba.njit(cache=True, error_model="numpy")(kernel)
    cache = dispatcher._cache
    files = cache._cache_file
    sealed: Any = _SealedFiles
    cache._cache_file = sealed(cache.cache_path, cache._impl.filename_base, files._source_stamp)
    return cast(Kernel, dispatcher)
