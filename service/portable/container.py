"""The file itself: a ZIP of JSON lines with a manifest of sizes and digests, equal for equal rows.

Entries have one order, one date and one compression, so that who exports the same again gets the same file.
Reading trusts nothing: names, sizes and digests are checked before a line is parsed, and no entry is
unpacked beyond what the manifest says.
"""

import hashlib
import re
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self, TypeVar

from pydantic import ValidationError

from core.faults import fault_lines
from service.portable.errors import PortableError
from service.portable.lines import Line, Manifest, Member

#: Certificates came with version 2: without them a file is as it was, and who knew no other reads it.
VERSION, VERSION_WITH_CERTIFICATES = 1, 2
MANIFEST, CERTIFICATES = "manifest.json", "certificates.ndjson"
#: All entries together, one line of them, entries, and the manifest [B].
MOST_BYTES, MOST_LINE_BYTES, MOST_MEMBERS, MOST_MANIFEST_BYTES = 4 * 2**30, 8 * 2**20, 5000, 2**20
#: ZIP knows no earlier date, and a file mode.
_DATE, _MODE = (1980, 1, 1, 0, 0, 0), 0o644 << 16
_NAME = re.compile(
    r"campaigns/[0-9]{2}/(campaign\.json|jobs\.ndjson|solves\.ndjson)|"
    r"(provenance|solutions|certificates)\.ndjson|targets/[0-9a-f]{32}\.bsp"
)
_CHUNK = 2**20

L = TypeVar("L", bound=Line)
#: An entry: its name, and its content piece by piece.
Entry = tuple[str, Iterable[bytes]]


def pack(stream: BinaryIO, campaign: str, entries: Iterable[Entry]) -> Manifest:
    """Write a file, entry by entry, and its manifest last."""
    members: dict[str, Member] = {}
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in entries:
            members[name] = _add(packed, name, content)
        version = VERSION_WITH_CERTIFICATES if CERTIFICATES in members else VERSION
        manifest = Manifest(format="coastarc campaign", version=version, campaign=campaign, members=members)
        _add(packed, MANIFEST, [manifest.written()])
    return manifest


def _add(packed: zipfile.ZipFile, name: str, content: Iterable[bytes]) -> Member:
    info = zipfile.ZipInfo(name, _DATE)
    info.compress_type, info.external_attr, info.create_system = zipfile.ZIP_DEFLATED, _MODE, 3
    with packed.open(info, "w", force_zip64=True) as entry:
        return _digested(content, entry.write)


def digest_of(content: Iterable[bytes]) -> Member:
    """Return size and digest of an entry without writing it."""
    return _digested(content, lambda piece: None)


def _digested(content: Iterable[bytes], take: Callable[[bytes], object]) -> Member:
    digest, n_bytes = hashlib.blake2b(digest_size=16), 0
    for piece in content:
        digest.update(piece)
        n_bytes += len(piece)
        take(piece)
    return Member(n_bytes=n_bytes, blake2b=digest.hexdigest())


class Unpacked:
    """A portable file, opened for reading; all digests hold."""

    def __init__(self, content: Path | BinaryIO, name: str | None = None) -> None:
        #: What errors call it.
        self.name = name or str(content)
        try:
            self._packed = zipfile.ZipFile(content)
        except (OSError, zipfile.BadZipFile, NotImplementedError) as error:
            reason = getattr(error, "strerror", None) or error
            raise self._fault("a portable file of a campaign", reason) from error
        try:
            self.manifest = self._read_manifest()
            self._check()
        except BaseException:
            self._packed.close()
            raise

    def __enter__(self) -> Self:
        """Give the file; it is closed at the end of the block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file."""
        self._packed.close()

    @property
    def n_campaigns(self) -> int:
        """Number of campaigns, those that others take seeds from first."""
        return sum(name.endswith("campaign.json") for name in self.manifest.members)

    def targets(self) -> list[str]:
        """Return the names of the target kernels."""
        return [name for name in self.manifest.members if name.startswith("targets/")]

    def content(self, name: str) -> bytes:
        """Return a small entry whole."""
        return b"".join(self._pieces(name))

    def one(self, name: str, kind: type[L]) -> L:
        """Return the one object of an entry."""
        return next(self.lines(name, kind))

    def lines(self, name: str, kind: type[L]) -> Iterator[L]:
        """Yield the objects of an entry, line by line."""
        for number, text in enumerate(self._texts(name), 1):
            try:
                yield kind.model_validate_json(text)
            except ValidationError as error:
                (first, *_) = fault_lines(name, error.errors(include_url=False), kind)
                raise PortableError(f"file {self.name}: line {number} of {first}") from error

    def _texts(self, name: str) -> Iterator[bytes]:
        if name not in self.manifest.members:
            raise self._fault(f"an entry {name}", "none")
        rest = b""
        for piece in self._pieces(name):
            *whole, rest = (rest + piece).split(b"\n")
            yield from whole
            if len(rest) > MOST_LINE_BYTES:
                raise self._fault(f"lines of at most {MOST_LINE_BYTES} bytes in {name}", "a longer one")
        if rest:
            raise self._fault(f"{name} to end with a line", "half of one")

    def _read_manifest(self) -> Manifest:
        names = [info.filename for info in self._packed.infolist()]
        if names.count(MANIFEST) != 1 or len(names) > MOST_MEMBERS:
            raise self._fault("a portable file of a campaign", "a ZIP without its manifest")
        if self._packed.getinfo(MANIFEST).file_size > MOST_MANIFEST_BYTES:
            raise self._fault(f"a manifest of at most {MOST_MANIFEST_BYTES} bytes", "a larger one")
        try:
            manifest = Manifest.model_validate_json(b"".join(self._pieces(MANIFEST)))
        except ValidationError as error:
            (first, *_) = fault_lines(MANIFEST, error.errors(include_url=False), Manifest)
            raise PortableError(f"file {self.name}: {first}") from error
        if manifest.version not in (VERSION, VERSION_WITH_CERTIFICATES):
            known = f"version {VERSION} or {VERSION_WITH_CERTIFICATES}"
            raise self._fault(known, f"{manifest.version}; install a newer coastarc")
        return manifest

    def _check(self) -> None:
        listed, present = self.manifest.members, [info.filename for info in self._packed.infolist()]
        if sorted(present) != sorted([*listed, MANIFEST]):
            raise self._fault("the entries of its manifest", "others, or one twice")
        for name, member in listed.items():
            if not _NAME.fullmatch(name):
                raise self._fault("entries of a campaign", repr(name[:80]))
            if self._packed.getinfo(name).file_size != member.n_bytes:
                raise self._fault(f"{member.n_bytes} bytes in {name}", "another number")
        if sum(member.n_bytes for member in listed.values()) > MOST_BYTES:
            raise self._fault(f"at most {MOST_BYTES >> 30} GiB", "more")
        for name, member in listed.items():
            if digest_of(self._pieces(name)) != member:
                raise self._fault(f"{name} with the digest of the manifest", "another; it has been changed")

    def _pieces(self, name: str) -> Iterator[bytes]:
        try:
            with self._packed.open(name) as entry:
                while piece := entry.read(_CHUNK):
                    yield piece
        except (OSError, EOFError, zipfile.BadZipFile, zlib.error, RuntimeError) as error:
            if isinstance(error, PortableError):
                raise
            raise self._fault(f"a whole entry {name}", error) from error

    def _fault(self, expected: str, got: object) -> PortableError:
        return PortableError(f"file {self.name}: expected {expected}, got {got}")
