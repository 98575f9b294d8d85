"""The one way in which coastarc compiles its kernels, and where the machine code is kept.

Numba notices a change in the file of a kernel, but not in a file that the kernel calls into.  So the
cache folder is named by a hash of all sources that a kernel can see, those from transcription downwards:
changed code never meets stale machine code.  It is named by their place as well: numba asks for the times of
the files too, and two copies of coastarc would throw away each other's kernels.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from platformdirs import user_cache_path

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


#: Folders that hold kernels, or what kernels import; imports point down, so nothing above is compiled.
KERNEL_FOLDERS = ("", "ephemeris", "orbits", "dynamics", "transcription")


def _sources_digest() -> str:
    place = Path(__file__).parent
    digest = hashlib.blake2b(f"{numba.__version__} {place}".encode(), digest_size=8)
    for folder in KERNEL_FOLDERS:
        for path in sorted((place / folder).glob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


numba.config.CACHE_DIR = str(  # type: ignore[attr-defined]
    user_cache_path("coastarc") / f"compiled-{_sources_digest()}"
)


def compiled(kernel: Kernel) -> Kernel:
    """Compile a kernel ahead of its first call per signature, cached on disk.

    Division by zero gives infinities, as in NumPy: a bad guess must end in a status, not an exception.
    The arithmetic is strictly IEEE.  With fused multiply-adds the compiler rounds a function differently in
    each place that it is inlined, and then a process that compiles and one that loads disagree.
    """
    return cast(Kernel, numba.njit(cache=True, error_model="numpy")(kernel))
