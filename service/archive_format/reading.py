"""Reads and checks a portable file line by line to its end, before anything is stored.

It is read again when it is stored: some lines at a time are in memory, never a whole entry.  Kernels of
targets and of worlds travel under the digest of their content: a specification names a file of one machine;
in a portable file it names an entry, and after an import a file in the data folder.  The hash of a problem
depends on the content alone.
"""

import copy
import hashlib
import os
import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from core.plain_data import PLANETS
from core.problem import Problem, SpkTarget, hashes_of
from core.search import HopAddress
from service.archive_format.checks import (
    Contents,
    Work,
    require_campaign,
    require_certificate,
    require_job,
    require_provenance,
    require_solution_line,
    require_solve_line,
)
from service.archive_format.container import CERTIFICATES, PortableError, Unpacked
from service.archive_format.lines import (
    CampaignLine,
    CertificateLine,
    JobLine,
    ProvenanceLine,
    SolutionLine,
    SolveLine,
)
from service.spec import Spec, SpecError, spec_from

_ENTRY = re.compile(r"targets/([0-9a-f]{32})\.bsp")


#: The tables of a problem that name a file of this machine, and the field with its path.
_FILES = (("target", "path"), ("world", "kernel"))


def kernel_entries(specs: list[Spec]) -> dict[str, Path]:
    """Return the kernels of targets and worlds of specifications by their names in a portable file."""
    kernels = [path for spec in specs for path in _kernels_of(spec.problem) if path.name != PLANETS]
    return {entry_of(path): path for path in kernels}


def _kernels_of(problem: Problem) -> list[Path]:
    of_target = problem.target.path if isinstance(problem.target, SpkTarget) else None
    of_world = problem.world.kernel if problem.world is not None else None
    return [path for path in (of_target, of_world) if path is not None]


def entry_of(path: Path) -> str:
    """Return the name of a kernel in a portable file; planets are at hand everywhere."""
    if path.name == PLANETS:
        return PLANETS
    return f"targets/{hashlib.blake2b(_content(path), digest_size=16).hexdigest()}.bsp"


def portable_fields(spec: Spec) -> dict[str, Any]:
    """Return a specification as plain data that names no file of this machine."""
    fields = spec.as_fields()
    for table, key in _FILES:
        if (path := _named(fields, table, key)) is not None:
            fields["problem"][table][key] = entry_of(Path(path))
    return fields


def local_fields(fields: dict[str, Any], folder: Path, entries: list[str]) -> dict[str, Any]:
    """Return the same with the files in a data folder, which nobody else gets to name."""
    changed = copy.deepcopy(fields)
    for table, key in _FILES:
        path = _named(fields, table, key)
        if path is None or path == PLANETS:
            continue
        if path not in entries:
            raise PortableError(f"{table}: expected a kernel in the same file, got {str(path)[:40]!r}")
        changed["problem"][table][key] = str(_place(folder, path))
    return changed


def _named(fields: dict[str, Any], table: str, key: str) -> Any:
    """Return the path that a table of a problem names, if any."""
    problem = fields.get("problem")
    part = problem.get(table) if isinstance(problem, dict) else None
    if not isinstance(part, dict):
        return None
    # A target of this kind without a path is refused as one with a strange path is.
    return part.get(key, "" if part.get("kind") == "spk" else None)


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


@dataclass(frozen=True, slots=True)
class ReadCampaign:
    """A campaign of a portable file, with its specification and where the rest of it stands."""

    line: CampaignLine
    spec: Spec
    folder: str

    @property
    def hashes(self) -> list[list[str]]:
        """The hashes of the problems by search and case."""
        return [hashes_of(self.spec.problems_of(search)) for search in self.spec.search]


@dataclass(frozen=True, slots=True)
class ReadFile:
    """A portable file that passed all checks."""

    unpacked: Unpacked
    campaigns: list[ReadCampaign]
    contents: Contents

    def provenances(self) -> Iterator[list[ProvenanceLine]]:
        """Yield the provenances, some at a time."""
        return self.unpacked.batches("provenance.ndjson", ProvenanceLine)

    def solutions(self) -> Iterator[list[SolutionLine]]:
        """Yield the solutions, some at a time."""
        return self.unpacked.batches("solutions.ndjson", SolutionLine)

    def certificates(self) -> Iterator[list[CertificateLine]]:
        """Yield the certificates, some at a time; none need be there."""
        if CERTIFICATES in self.unpacked.manifest.members:
            yield from self.unpacked.batches(CERTIFICATES, CertificateLine)

    def jobs(self, campaign: ReadCampaign) -> Iterator[list[JobLine]]:
        """Yield the jobs of a campaign, some at a time."""
        return self.unpacked.batches(f"{campaign.folder}/jobs.ndjson", JobLine)

    def solves(self, campaign: ReadCampaign) -> Iterator[list[SolveLine]]:
        """Yield the solves of a campaign, some at a time."""
        return self.unpacked.batches(f"{campaign.folder}/solves.ndjson", SolveLine)


def read_all(unpacked: Unpacked, data: Path) -> ReadFile:
    """Return a portable file whose every line has been judged; targets stand in the data folder.

    Raises
    ------
    PortableError
        At the first line that cannot be so.
    """
    campaigns = _campaigns(unpacked, data)
    if not campaigns or campaigns[-1].line.spec_hash != unpacked.manifest.campaign:
        raise PortableError(f"file {unpacked.name}: expected the campaign of its manifest last, got another")
    problems: dict[str, Problem] = {}
    for campaign in campaigns:
        for search in campaign.spec.search:
            listed = campaign.spec.problems_of(search)
            problems |= dict(zip(hashes_of(listed), listed, strict=True))
    read = ReadFile(unpacked, campaigns, Contents(problems))
    for provenance in chain.from_iterable(read.provenances()):
        require_provenance(provenance, read.contents)
    for solution in chain.from_iterable(read.solutions()):
        require_solution_line(solution, read.contents)
    for certificate in chain.from_iterable(read.certificates()):
        require_certificate(certificate, read.contents)
    for campaign in campaigns:
        _require_work(read, campaign)
    if lonely := read.contents.solutions.keys() - read.contents.found_at.keys():
        raise PortableError(f"solution {min(lonely)}: expected a solve that found it, got none")
    return read


def _campaigns(unpacked: Unpacked, data: Path) -> list[ReadCampaign]:
    known: dict[str, Spec] = {}
    found: list[ReadCampaign] = []
    for number in range(unpacked.n_campaigns):
        folder = f"campaigns/{number:02d}"
        line = unpacked.one(f"{folder}/campaign.json", CampaignLine)
        try:
            spec = spec_from(local_fields(line.spec, data, unpacked.targets()), allow_files=True)
        except SpecError as error:
            raise PortableError(f"file {unpacked.name}: {folder}: {error}") from error
        require_campaign(line, spec, known)
        known[line.spec_hash] = spec
        found.append(ReadCampaign(line, spec, folder))
    return found


def _require_work(read: ReadFile, campaign: ReadCampaign) -> None:
    contents, settings = read.contents, tuple(search.settings for search in campaign.spec.search)
    contents.jobs.clear()
    contents.work = Work(campaign.spec.campaign.rng_seed, campaign.hashes, settings)
    addresses: set[HopAddress] = set()
    for number, job in enumerate(chain.from_iterable(read.jobs(campaign))):
        address = require_job(job, number, campaign.spec, contents)
        if address in addresses:
            raise PortableError(f"job {number}: expected each address once, got {job.address} twice")
        addresses.add(address)
    # Of a number each: there may be a million.
    hops: set[int] = set()
    for number, solve in enumerate(chain.from_iterable(read.solves(campaign))):
        require_solve_line(solve, number, contents)
        if (key := solve.job << 64 | solve.hop) in hops:
            raise PortableError(f"solve {number}: expected each hop of a job once, got {solve.hop} twice")
        hops.add(key)
