"""What the times of a benchmark depend on beside its settings."""

import os
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path

#: Packages on which the speed depends.
PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "cyipopt-wheels")


def machine() -> dict[str, str]:
    """Return processor, versions and the revision of the code."""
    from workers.provenance import code_version

    versions = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
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
