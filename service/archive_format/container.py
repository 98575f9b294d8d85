"""The container: a ZIP of JSON lines with a manifest of sizes and digests, reproducible byte by byte.

Entries have one order, one date and one compression, so that the same export gives the same file.  Reading
trusts nothing: names, sizes and digests are checked before a line is parsed, and no entry is unpacked beyond
what the manifest says.  Zeros pack a thousand to one, so a small file may be large inside: what is in memory
at once is bounded by a line, or by some small ones, and never depends on the whole.
"""

import hashlib
import re
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self, TypeVar

from pydantic import ValidationError

from core.errors import UserError, fault_lines
from service.archive_format.lines import Line, Manifest, Member

#: Faults of one line of a file that are looked through for the first that explains the others.  A list of
#: two million things that are no numbers is 20 kB in a file, and its faults are 2 GiB.
MOST_FAULTS = 1000


class PortableError(UserError, RuntimeError):
    """A portable file that cannot be written or is rejected; nothing was changed."""


class PortableConflictError(PortableError):
    """A conflict with the archive: a campaign still at work, or the same one with other results."""


def first_fault(thing: str, error: ValidationError, kind: Any) -> str:
    """Return what is wrong with data of a model, in one line."""
    if (n := error.error_count()) > MOST_FAULTS:
        return f"{thing}: expected {kind.__name__}, got {n} faults"
    (first, *_) = fault_lines(thing, error.errors(include_url=False), kind)
    return first


#: Certificates came with version 2: without them a file is as it was, and who knew no other reads it.
VERSION, VERSION_WITH_CERTIFICATES = 1, 2
MANIFEST, CERTIFICATES = "manifest.json", "certificates.ndjson"
#: All entries together, one line of them, entries, and the manifest [B].
MOST_BYTES, MOST_LINE_BYTES, MOST_MEMBERS, MOST_MANIFEST_BYTES = 4 * 2**30, 8 * 2**20, 5000, 2**20
#: Numbers, texts and tables in one line: each takes a hundred bytes of memory however short it is.  The
#: longest lines are solutions, with a vector and defects of 100,000 numbers at most.
MOST_VALUES = 300_000
#: Lines of one entry: ten times the jobs or solves of a large campaign.  Of each some 400 bytes stay in
#: memory until the end, since others refer to it.
MOST_LINES = 1_000_000
#: Longest list of entries in a ZIP, which is read whole before anything else is known [B].
MOST_LIST_BYTES = 2 * 2**20
#: Lines that are in memory together, and their length; one longer than that is alone [B].
LINES_AT_ONCE, BYTES_AT_ONCE = 2000, 2**20
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
        return _digest_chunks(content, entry.write)


def digest_of(content: Iterable[bytes]) -> Member:
    """Return size and digest of an entry without writing it."""
    return _digest_chunks(content, lambda piece: None)


def _digest_chunks(content: Iterable[bytes], take: Callable[[bytes], object]) -> Member:
    digest, n_bytes = hashlib.blake2b(digest_size=16), 0
    for piece in content:
        digest.update(piece)
        n_bytes += len(piece)
        take(piece)
    return Member(n_bytes=n_bytes, blake2b=digest.hexdigest())


class _InPieces:
    """A file that is read in bounded pieces, whatever its directory claims."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.seek, self.tell, self.seekable = file.seek, file.tell, file.seekable

    def read(self, n_bytes: int = -1) -> bytes:
        if n_bytes > MOST_LIST_BYTES:
            raise zipfile.BadZipFile(f"a list of more than {MOST_LIST_BYTES} bytes of entries")
        return self._file.read(n_bytes)


class Unpacked:
    """A portable file, opened for reading; all digests hold."""

    def __init__(self, content: Path | BinaryIO, name: str | None = None) -> None:
        #: What errors call it.
        self.name = name or str(content)
        with ExitStack() as opened:
            try:
                file = opened.enter_context(content.open("rb")) if isinstance(content, Path) else content
                self._packed = opened.enter_context(zipfile.ZipFile(_InPieces(file)))
            except (OSError, zipfile.BadZipFile, NotImplementedError) as error:
                reason = getattr(error, "strerror", None) or error
                raise self._fault("a portable file of a campaign", reason) from error
            self.manifest = self._read_manifest()
            self._check()
            self._opened = opened.pop_all()

    def __enter__(self) -> Self:
        """Give the file; it is closed at the end of the block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._opened.close()

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
        return chain.from_iterable(self.batches(name, kind))

    def batches(self, name: str, kind: type[L]) -> Iterator[list[L]]:
        """Yield the objects of an entry, as many at once as take little memory."""
        batch: list[L] = []
        n_bytes = 0
        for number, text in enumerate(self._texts(name), 1):
            if batch and (len(batch) >= LINES_AT_ONCE or n_bytes + len(text) > BYTES_AT_ONCE):
                yield batch
                batch, n_bytes = [], 0
            batch.append(self._parse(name, number, text, kind))
            n_bytes += len(text)
        if batch:
            yield batch

    def _parse(self, name: str, number: int, text: bytes, kind: type[L]) -> L:
        if number > MOST_LINES:
            raise self._fault(f"at most {MOST_LINES} lines in {name}", "more")
        # Those within texts count too: there are few.
        if sum(map(text.count, (b",", b"[", b"{"))) > MOST_VALUES:
            raise self._fault(f"at most {MOST_VALUES} values in line {number} of {name}", "more")
        try:
            return kind.model_validate_json(text)
        except ValidationError as error:
            first = first_fault(name, error, kind)
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
            raise PortableError(f"file {self.name}: {first_fault(MANIFEST, error, Manifest)}") from error
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
