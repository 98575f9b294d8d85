"""A portable file read and judged as a whole, before anything of it is stored."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from core.problem import Problem
from service.portable.checks import (
    Contents,
    require_campaign,
    require_certificate,
    require_job,
    require_provenance,
    require_solution_line,
    require_solve_line,
)
from service.portable.container import CERTIFICATES, Unpacked
from service.portable.errors import PortableError
from service.portable.lines import (
    CampaignLine,
    CertificateLine,
    JobLine,
    ProvenanceLine,
    SolutionLine,
    SolveLine,
)
from service.portable.targets import local_fields
from service.spec import Spec, SpecError, spec_from


@dataclass(frozen=True, slots=True)
class ReadCampaign:
    """A campaign of a portable file, with its specification and where the rest of it stands."""

    line: CampaignLine
    spec: Spec
    folder: str

    @property
    def hashes(self) -> list[list[str]]:
        """The hashes of the problems by search and case."""
        return [[problem.hash for problem in self.spec.problems_of(search)] for search in self.spec.search]


@dataclass(frozen=True, slots=True)
class ReadFile:
    """A portable file that may be taken in."""

    unpacked: Unpacked
    campaigns: list[ReadCampaign]
    contents: Contents

    def provenances(self) -> Iterator[ProvenanceLine]:
        """Yield the provenances."""
        return self.unpacked.lines("provenance.ndjson", ProvenanceLine)

    def solutions(self) -> Iterator[SolutionLine]:
        """Yield the solutions."""
        return self.unpacked.lines("solutions.ndjson", SolutionLine)

    def certificates(self) -> Iterator[CertificateLine]:
        """Yield the certificates, none of which need be there."""
        if CERTIFICATES in self.unpacked.manifest.members:
            yield from self.unpacked.lines(CERTIFICATES, CertificateLine)

    def jobs(self, campaign: ReadCampaign) -> Iterator[JobLine]:
        """Yield the jobs of a campaign."""
        return self.unpacked.lines(f"{campaign.folder}/jobs.ndjson", JobLine)

    def solves(self, campaign: ReadCampaign) -> Iterator[SolveLine]:
        """Yield the solves of a campaign."""
        return self.unpacked.lines(f"{campaign.folder}/solves.ndjson", SolveLine)


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
            problems |= {problem.hash: problem for problem in campaign.spec.problems_of(search)}
    read = ReadFile(unpacked, campaigns, Contents(problems))
    for provenance in read.provenances():
        require_provenance(provenance, read.contents)
    for solution in read.solutions():
        require_solution_line(solution, read.contents)
    for certificate in read.certificates():
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
    read.contents.jobs.clear()
    addresses: set[tuple[int, str, int, str, int]] = set()
    hashes, settings = campaign.hashes, [search.settings for search in campaign.spec.search]
    for number, job in enumerate(read.jobs(campaign)):
        require_job(job, number, campaign.spec, settings, hashes, read.contents)
        if job.address in addresses:
            raise PortableError(f"job {number}: expected each address once, got {job.address} twice")
        addresses.add(job.address)
    hops = set()
    for number, solve in enumerate(read.solves(campaign)):
        require_solve_line(solve, number, read.contents)
        if (solve.job, solve.hop) in hops:
            raise PortableError(f"solve {number}: expected each hop of a job once, got {solve.hop} twice")
        hops.add((solve.job, solve.hop))
