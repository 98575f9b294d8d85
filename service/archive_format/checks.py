"""Consistency checks of a portable file.

Digests show damage; here what somebody may have written on purpose is held against what follows from it:
hashes from contents, and solves and solutions by the rules of `service.validation`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from pydantic import ValidationError

from core.plain_data import content_hash
from core.problem import Problem
from core.search import HopAddress
from core.verification.verify import holds
from core.world import world_of
from service.archive_format.container import PortableError, first_fault
from service.archive_format.lines import (
    CampaignLine,
    CertificateLine,
    JobLine,
    ProvenanceLine,
    SolutionLine,
    SolveLine,
)
from service.spec import Spec
from service.validation import (
    JobFacts,
    ProblemFacts,
    UnsoundError,
    facts_of,
    require_hash,
    require_solution,
    require_solve,
)
from workers.certificate import CertificateContent
from workers.messages import KIND_NUMBERS, JobSettings


def require_campaign(line: CampaignLine, spec: Spec, known: Mapping[str, Spec]) -> None:
    """Refuse a campaign with another hash or other searches than its specification, or without its seeds."""
    thing = f"campaign {spec.campaign.name}"
    if spec.hash != line.spec_hash:
        raise PortableError(
            f"{thing}: expected the hash {spec.hash} of its specification, got {line.spec_hash}; it was "
            f"changed, or made by a coastarc with other constants or kernels"
        )
    expected, got = [search.id for search in spec.search], [search.name for search in line.searches]
    if expected != got:
        raise PortableError(f"{thing}: expected searches {', '.join(expected)}, got {', '.join(got)}")
    for search, row in zip(spec.search, line.searches, strict=True):
        if (search.seeds is None) != (row.source is None):
            raise PortableError(f"{thing}: expected a source of seeds as specified, got search {row.name}")
        if row.source is None or search.seeds is None:
            continue
        owner = spec if row.source.campaign == line.spec_hash else known.get(row.source.campaign)
        is_own = search.seeds.campaign is None
        if owner is None or is_own != (owner is spec) or row.source.search != search.seeds.source:
            raise PortableError(
                f"{thing}: expected the seeds of search {row.name} from {search.seeds.full_name} in the same "
                f"file, got {row.source.search} of {row.source.campaign}"
            )


class ReadJob(NamedTuple):
    """A job of the file, compact because there may be a million."""

    address: HopAddress
    n_hops: int
    #: Its attempts with results.
    attempts: tuple[int, ...]


class Work(NamedTuple):
    """What the jobs of a campaign have in common."""

    rng_seed: int
    #: Of the problems, by search and case.
    hashes: list[list[str]]
    #: By search.
    settings: tuple[JobSettings, ...]


#: Before the jobs of a campaign are read.
NO_WORK = Work(0, [], ())


@dataclass(slots=True)
class Contents:
    """What has been read of a file so far, for later lines to refer to."""

    #: By hash, those of all cases.
    problems: Mapping[str, Problem]
    provenances: set[str] = field(default_factory=set)
    #: Problem, final mass and levels of the solutions.
    solutions: dict[str, tuple[str, float, bool, bool]] = field(default_factory=dict)
    #: When a solve found them first.
    found_at: dict[str, float] = field(default_factory=dict)
    #: Those of one campaign.
    jobs: list[ReadJob] = field(default_factory=list)
    work: Work = NO_WORK
    #: Of the problems, as far as they have been asked for.
    facts: dict[str, ProblemFacts] = field(default_factory=dict)

    def facts_of(self, problem_hash: str) -> ProblemFacts:
        """Return what the figures of solutions of a problem follow from."""
        if problem_hash not in self.facts:
            self.facts[problem_hash] = facts_of(self.problems[problem_hash], problem_hash)
        return self.facts[problem_hash]

    def job_facts(self, job: ReadJob) -> JobFacts:
        """Return what the solves of a job have to agree with."""
        search, case = job.address.search, job.address.case
        about = self.facts_of(self.work.hashes[search][case])
        return JobFacts(about, self.work.rng_seed, job.address, job.n_hops, self.work.settings[search])


def require_provenance(line: ProvenanceLine, contents: Contents) -> None:
    """Refuse a provenance under another hash than its own."""
    if content_hash(line.content) != line.hash:
        raise PortableError(f"provenance {line.hash}: expected the hash of its content, got another")
    contents.provenances.add(line.hash)


def require_solution_line(line: SolutionLine, contents: Contents) -> None:
    """Refuse a solution of another hash, of an unknown problem, or with figures that are not its own."""
    thing = f"solution {line.id}"
    if line.problem not in contents.problems:
        raise PortableError(f"{thing}: expected a problem of the campaign, got {line.problem}")
    about, defects = contents.facts_of(line.problem), np.array(line.defects, dtype=np.float64)
    try:
        x = require_solution(thing, about, np.array(line.x), vars(line), defects, (line.paper, line.strict))
        require_hash(thing, about, x, line.id)
    except UnsoundError as error:
        raise PortableError(str(error)) from error
    contents.solutions[line.id] = (about.hash, line.objective_kg, line.paper, line.strict)


def require_certificate(line: CertificateLine, contents: Contents) -> None:
    """Refuse a certificate of no solution here, of another hash, or with a verdict that is not its own."""
    thing = f"certificate {line.hash} of solution {line.solution}"
    try:
        content = CertificateContent.model_validate(line.content)
    except ValidationError as error:
        raise PortableError(first_fault(thing, error, CertificateContent)) from error
    if line.solution not in contents.solutions or line.solution != content.solution_id:
        raise PortableError(
            f"{thing}: expected one of a solution in the same file, got {content.solution_id}"
        )
    if content_hash(content.model_dump(mode="json")) != line.hash:
        raise PortableError(f"{thing}: expected the hash of its content, got another")
    problem = contents.problems[contents.solutions[line.solution][0]]
    if (content.problem_hash, content.k) != (problem.hash, problem.k):
        raise PortableError(f"{thing}: expected the problem of its solution, got {content.problem_hash}")
    if not is_own_verdict(content, problem):
        raise PortableError(f"{thing}: expected a verdict from its defects and marks, got {content.level}")


def is_own_verdict(content: CertificateContent, problem: Problem) -> bool:
    """Return whether the verdict of a certificate follows from its defects and its marks."""
    rows = [trajectory.defect for trajectory in content.trajectories]
    if [len(row) for row in rows] != [7] * (1 + content.k):
        return False
    defects = np.array(rows, dtype=np.float64)
    world = world_of(problem)
    holds_level = {"strict": holds(defects, world.strict), "paper": holds(defects, world.loose), "none": True}
    is_sound = content.level != "none" and not content.marks
    return holds_level[content.level] and content.is_sound == is_sound


def require_job(line: JobLine, number: int, spec: Spec, contents: Contents) -> HopAddress:
    """Return the address of a job; refuse one outside of its search, or with a seed that is not there."""
    if line.search >= len(spec.search):
        raise PortableError(f"job {number}: expected a search of the campaign, got number {line.search}")
    search = spec.search[line.search]
    is_map = line.kind == "map"
    has_seed = line.seed is not None and line.mapping is not None
    if is_map != (search.seed_k is not None) or is_map != has_seed or line.case >= len(search.outage_sets):
        raise PortableError(f"job {number}: expected one of search {search.id}, got {line.address}")
    if line.seed is not None:
        if line.seed not in contents.solutions:
            raise PortableError(f"job {number}: expected a seed in the same file, got {line.seed}")
        if line.chain != line.seed:
            raise PortableError(f"job {number}: expected the chain of its seed, got {line.chain}")
    for attempt in line.attempts:
        if attempt.provenance is not None and attempt.provenance not in contents.provenances:
            raise PortableError(f"job {number}: expected a provenance in the same file, got another")
    made = tuple(attempt.attempt for attempt in line.attempts if attempt.provenance is not None)
    address = HopAddress(KIND_NUMBERS[line.kind], line.search, line.case, int(line.chain, 16), line.hop)
    contents.jobs.append(ReadJob(address, line.n_hops, made))
    return address


def require_solve_line(line: SolveLine, number: int, contents: Contents) -> None:
    """Refuse a solve of no job or attempt, or with a solution that is not one of its problem."""
    thing = f"solve {number}"
    if line.job >= len(contents.jobs):
        raise PortableError(f"{thing}: expected a job of the campaign, got line {line.job}")
    job = contents.jobs[line.job]
    facts = contents.job_facts(job)
    if line.attempt not in job.attempts:
        raise PortableError(f"{thing}: expected an attempt of its job, got {line.attempt}")
    try:
        require_solve(thing, facts, line, len(line.defects), line.solution is not None)
    except UnsoundError as error:
        raise PortableError(str(error)) from error
    if line.solution is None:
        return
    found = contents.solutions.get(line.solution)
    if found is None or found[0] != facts.about.hash:
        raise PortableError(f"{thing}: expected a solution of its problem, got {line.solution}")
    if found[2:] != (line.paper, line.strict):
        raise PortableError(f"{thing}: expected the levels of its solution, got others")
    earlier = contents.found_at.get(line.solution, line.created_at)
    contents.found_at[line.solution] = min(earlier, line.created_at)
