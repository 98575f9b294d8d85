"""The kernels of targets that a portable file carries, under the digest of their content.

A specification names a file of one machine; in a portable file it names an entry, and where that is taken
in, a file in the data folder.  The hash of a problem depends on the content alone.
"""

import copy
import hashlib
import os
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from core.problem import SpkTarget
from service.portable.container import Unpacked
from service.portable.errors import PortableError
from service.spec import Spec

_ENTRY = re.compile(r"targets/([0-9a-f]{32})\.bsp")


def target_entries(specs: list[Spec]) -> dict[str, Path]:
    """Return the files of the targets of specifications by their names in a portable file."""
    targets = [spec.problem.target for spec in specs]
    return {entry_of(target): target.path for target in targets if isinstance(target, SpkTarget)}


def entry_of(target: SpkTarget) -> str:
    """Return the name of a target's kernel in a portable file."""
    return f"targets/{hashlib.blake2b(_content(target.path), digest_size=16).hexdigest()}.bsp"


def portable_fields(spec: Spec) -> dict[str, Any]:
    """Return a specification as plain data that names no file of this machine."""
    fields, target = spec.as_fields(), spec.problem.target
    if isinstance(target, SpkTarget):
        fields["problem"]["target"]["path"] = entry_of(target)
    return fields


def local_fields(fields: dict[str, Any], folder: Path, entries: list[str]) -> dict[str, Any]:
    """Return the same with the file in a data folder, which nobody else gets to name."""
    problem = fields.get("problem")
    target = problem.get("target") if isinstance(problem, dict) else None
    if not isinstance(target, dict) or (target.get("kind") != "spk" and "path" not in target):
        return fields
    if target.get("path") not in entries:
        raise PortableError(
            f"target: expected a kernel in the same file, got {str(target.get('path'))[:40]!r}"
        )
    changed = copy.deepcopy(fields)
    changed["problem"]["target"]["path"] = str(_place(folder, target["path"]))
    return changed


def unpack_targets(unpacked: Unpacked, folder: Path) -> Iterator[Path]:
    """Write the kernels of a portable file to a data folder; yield those that were not there."""
    for name in unpacked.targets():
        content = unpacked.content(name)
        match = _ENTRY.fullmatch(name)
        if match is None or hashlib.blake2b(content, digest_size=16).hexdigest() != match[1]:
            raise PortableError(f"target {name}: expected the digest of its content as its name, got another")
        place = _place(folder, name)
        if not place.is_file():
            _write(place, content)
            yield place


def _place(folder: Path, entry: str) -> Path:
    return folder.resolve() / entry


def _write(place: Path, content: bytes) -> None:
    try:
        place.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        descriptor, draft = tempfile.mkstemp(dir=place.parent)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content)
        os.replace(draft, place)
    except OSError as error:
        raise PortableError(
            f"target {place.name}: expected a place to write it, got {error.strerror}"
        ) from error


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise PortableError(f"target {path}: expected its kernel, got {error.strerror}") from error
