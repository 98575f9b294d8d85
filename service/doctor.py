"""Checks of the installation, each with a remedy."""

import importlib.metadata
import os
import platform
import shutil
from collections.abc import Callable
from pathlib import Path

from service.coordinator.lock import openness
from service.schemas.answer import Check

GIGABYTE = 1e9
#: A campaign of 10,000 solutions needs about a tenth of this.
LEAST_FREE_BYTES = 0.5 * GIGABYTE


def check_all(folder: Path, port: int) -> list[Check]:
    """Return all checks; one that raises has failed, with what it raised."""
    looks: dict[str, Callable[[], Check]] = {
        "python": _python,
        "packages": _packages,
        "kernels": _kernels,
        "solver": _solver,
        "numba cache": _numba_cache,
        "threads": _threads,
        "disk": lambda: _disk(folder),
        "port": lambda: _port(port),
    }
    return [_run_check(name, look) for name, look in looks.items()]


def _run_check(name: str, look: Callable[[], Check]) -> Check:
    try:
        return look()
    except Exception as error:
        advice = "install coastarc again: pip install -e ."
        return Check(name=name, state="failed", found=f"{type(error).__name__}: {error}", advice=advice)


def _python() -> Check:
    found = f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    return Check(name="python", state="ok", found=found)


def _packages() -> Check:
    from workers.provenance import PACKAGES, code_version

    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in PACKAGES)
    return Check(name="packages", state="ok", found=f"coastarc {code_version()}; {versions}")


def _kernels() -> Check:
    from core.ephemeris.kernels import check_kernels, kernel_hashes

    check_kernels()
    listed = ", ".join(f"{name} {digest[:8]}" for name, digest in kernel_hashes().items())
    return Check(name="kernels", state="ok", found=f"{listed}; DE440 is the published file")


def _solver() -> Check:
    import cyipopt

    version = ".".join(map(str, cyipopt.IPOPT_VERSION))
    return Check(name="solver", state="ok", found=f"IPOPT {version} through cyipopt {cyipopt.__version__}")


def _numba_cache() -> Check:
    from core import jit
    from core.cache import cache_note

    folder = jit.COMPILED_FOLDER
    try:
        folder.mkdir(parents=True, exist_ok=True)
        is_writable = os.access(folder, os.W_OK)
    except OSError:
        is_writable = False
    advice = "make it writable, or set XDG_CACHE_HOME to a folder that is"
    if not is_writable:
        return Check(name="numba cache", state="failed", found=f"{folder} cannot be written", advice=advice)
    if note := cache_note():
        return Check(name="numba cache", state="warning", found=note.partition("; make")[0], advice=advice)
    n_files = sum(1 for _ in folder.rglob("*.nbc"))
    advice = "" if n_files else "nothing to do: the first run compiles, which takes about a minute"
    return Check(name="numba cache", state="ok", found=f"{n_files} kernels in {folder}", advice=advice)


def _threads() -> Check:
    from threadpoolctl import threadpool_info, threadpool_limits

    from workers.process_tree import require_one_thread

    with threadpool_limits(1):
        require_one_thread()
    names = ", ".join(sorted({library["internal_api"] for library in threadpool_info()}))
    return Check(name="threads", state="ok", found=f"{os.cpu_count()} cores; {names} obey the limit of 1")


def _disk(folder: Path) -> Check:
    existing = next(place for place in (folder, *folder.parents) if place.exists())
    free = shutil.disk_usage(existing).free
    found = f"{free / GIGABYTE:.1f} GB free for {folder}"
    if not os.access(existing, os.W_OK):
        return Check(name="disk", state="failed", found=f"{existing} is read-only", advice="use --data")
    if free < LEAST_FREE_BYTES:
        return Check(name="disk", state="warning", found=found, advice="free some space, or use --data")
    if existing == folder and (fault := openness(folder)):
        found, _, advice = fault.partition("; ")
        return Check(name="disk", state="warning", found=found, advice=advice)
    return Check(name="disk", state="ok", found=found)


def _port(port: int) -> Check:
    from service.coordinator import CoordinatorError, open_port

    try:
        open_port("127.0.0.1", port).close()
    except CoordinatorError as error:
        advice = "a coordinator may be running already; otherwise use --port"
        return Check(name="port", state="warning", found=str(error), advice=advice)
    return Check(name="port", state="ok", found=f"127.0.0.1:{port} is free")
