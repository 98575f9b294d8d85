"""Whether what a portable file says of a campaign can be so.

Digests show damage; here what somebody may have written on purpose is held against what follows from it:
hashes from contents, the figures of a solution from its vector, its levels from its defects.  Only the
defects themselves are believed, and what else certificates say of flights; `coastarc solutions verify` flies
them again.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from core.analysis.metrics import total_delta_v_km_s, transfer_delta_v_km_s
from core.analysis.verify import holds
from core.constants import SECONDS_PER_DAY
from core.faults import fault_lines
from core.orbits import departure_state
from core.problem import Problem, content_hash, seconds_past_j2000
from core.tolerances import PAPER, STRICT
from core.transcription import checked_vector, layout_of
from service.portable.errors import PortableError
from service.portable.lines import (
    CampaignLine,
    CertificateLine,
    JobLine,
    ProvenanceLine,
    SolutionLine,
    SolveLine,
)
from service.solutions.solution_hash import solution_hash
from service.spec import Spec
from workers.certificate import CertificateContent

#: Figures are worked out again; other machines round otherwise, and epochs are kept to a millisecond.
RELATIVE, EPOCH_S = 1e-9, 2e-3


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


@dataclass(slots=True)
class Contents:
    """What has been read of a file, for what follows to refer to."""

    #: By hash, those of all cases.
    problems: Mapping[str, Problem]
    provenances: set[str] = field(default_factory=set)
    #: Problem, final mass and levels of the solutions.
    solutions: dict[str, tuple[str, float, bool, bool]] = field(default_factory=dict)
    #: When a solve found them first.
    found_at: dict[str, float] = field(default_factory=dict)
    #: Search, case and attempts with results of the jobs of one campaign.
    jobs: list[tuple[int, int, tuple[int, ...]]] = field(default_factory=list)


def require_provenance(line: ProvenanceLine, contents: Contents) -> None:
    """Refuse a provenance under another hash than its own."""
    if content_hash(line.content) != line.hash:
        raise PortableError(f"provenance {line.hash}: expected the hash of its content, got another")
    contents.provenances.add(line.hash)


def require_solution(line: SolutionLine, contents: Contents) -> None:
    """Refuse a solution of another hash, of an unknown problem, or with figures that are not its own."""
    thing = f"solution {line.id}"
    problem = contents.problems.get(line.problem)
    if problem is None:
        raise PortableError(f"{thing}: expected a problem of the campaign, got {line.problem}")
    try:
        x = checked_vector(layout_of(problem), np.array(line.x))
    except ValueError as error:
        raise PortableError(f"{thing}: {error}") from error
    if solution_hash(line.problem, x) != line.id:
        raise PortableError(f"{thing}: expected the hash of its problem and its vector, got another")
    for name, expected in figures(problem, x).items():
        got = getattr(line, name)
        if not math.isclose(expected, got, rel_tol=RELATIVE, abs_tol=RELATIVE):
            raise PortableError(f"{thing}: expected {name} {expected} from its vector, got {got}")
    _require_epochs(line, problem)
    _require_levels(line, 1 + problem.k)
    contents.solutions[line.id] = (line.problem, line.objective_kg, line.paper, line.strict)


def figures(problem: Problem, x: NDArray[np.float64]) -> dict[str, float]:
    """Return what the archive keeps of a vector's reference, masses [kg], times [days], delta-v [km/s]."""
    own = layout_of(problem).reference
    start_kg = _departure(problem)[1]
    final_kg = float(x[own.final_mass])
    times = [float(x[place]) for place in (own.shooting_time, own.initial_coast, own.final_coast)]
    return {
        "objective_kg": final_kg,
        "propellant_kg": start_kg - final_kg,
        "delta_v_km_s": transfer_delta_v_km_s(problem, start_kg, final_kg),
        "delta_v_total_km_s": total_delta_v_km_s(problem, final_kg),
        "shooting_days": times[0],
        "initial_coast_days": times[1],
        "final_coast_days": times[2],
        "time_of_flight_days": sum(times),
    }


@lru_cache(maxsize=64)
def _departure(problem: Problem) -> tuple[float, float]:
    """Return epoch [TDB s past J2000] and mass [kg]."""
    start = departure_state(problem.departure, problem.spacecraft)
    return float(start.et), float(start.mass_kg)


def _require_epochs(line: SolutionLine, problem: Problem) -> None:
    arrival = _departure(problem)[0] + line.time_of_flight_days * SECONDS_PER_DAY
    insertion = arrival - line.final_coast_days * SECONDS_PER_DAY
    for name, expected in (("arrival_epoch", arrival), ("insertion_epoch", insertion)):
        text = getattr(line, name)
        try:
            is_so = abs(seconds_past_j2000(text) - expected) < EPOCH_S
        except ValueError:
            is_so = False
        if not is_so:
            raise PortableError(f"solution {line.id}: expected {name} from its vector, got {text[:40]!r}")


def _require_levels(line: SolutionLine, n_trajectories: int) -> None:
    defects = np.array(line.defects, dtype=np.float64)
    if defects.size != 7 * n_trajectories:
        raise PortableError(f"solution {line.id}: expected {7 * n_trajectories} defects, got {defects.size}")
    rows = defects.reshape(-1, 7)
    if (line.strict and not holds(rows, STRICT)) or (line.paper and not holds(rows, PAPER)):
        raise PortableError(f"solution {line.id}: expected defects within its level, got larger ones")


def require_certificate(line: CertificateLine, contents: Contents) -> None:
    """Refuse a certificate of no solution here, of another hash, or with a verdict that is not its own."""
    thing = f"certificate {line.hash} of solution {line.solution}"
    try:
        content = CertificateContent.model_validate(line.content)
    except ValidationError as error:
        (first, *_) = fault_lines(thing, error.errors(include_url=False), CertificateContent)
        raise PortableError(first) from error
    if line.solution not in contents.solutions or line.solution != content.solution_id:
        raise PortableError(
            f"{thing}: expected one of a solution in the same file, got {content.solution_id}"
        )
    if content_hash(content.model_dump(mode="json")) != line.hash:
        raise PortableError(f"{thing}: expected the hash of its content, got another")
    problem = contents.problems[contents.solutions[line.solution][0]]
    if (content.problem_hash, content.k) != (problem.hash, problem.k):
        raise PortableError(f"{thing}: expected the problem of its solution, got {content.problem_hash}")
    if not _is_own_verdict(content):
        raise PortableError(f"{thing}: expected a verdict from its defects and marks, got {content.level}")


def _is_own_verdict(content: CertificateContent) -> bool:
    rows = [trajectory.defect for trajectory in content.trajectories]
    if [len(row) for row in rows] != [7] * (1 + content.k):
        return False
    defects = np.array(rows, dtype=np.float64)
    holds_level = {"strict": holds(defects, STRICT), "paper": holds(defects, PAPER), "none": True}
    is_sound = content.level != "none" and not content.marks
    return holds_level[content.level] and content.is_sound == is_sound


def require_job(line: JobLine, number: int, spec: Spec, contents: Contents) -> None:
    """Refuse a job outside of its search, or with a seed that is not there."""
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
    contents.jobs.append((line.search, line.case, made))


def require_solve(line: SolveLine, number: int, hashes: list[list[str]], contents: Contents) -> None:
    """Refuse a solve of no job or attempt, or with a solution that is not one of its problem."""
    thing = f"solve {number}"
    if line.job >= len(contents.jobs):
        raise PortableError(f"{thing}: expected a job of the campaign, got line {line.job}")
    search, case, attempts = contents.jobs[line.job]
    if line.attempt not in attempts:
        raise PortableError(f"{thing}: expected an attempt of its job, got {line.attempt}")
    if line.solution is None:
        return
    found = contents.solutions.get(line.solution)
    if found is None or found[0] != hashes[search][case]:
        raise PortableError(f"{thing}: expected a solution of its problem, got {line.solution}")
    if found[2:] != (line.paper, line.strict):
        raise PortableError(f"{thing}: expected the levels of its solution, got others")
    earlier = contents.found_at.get(line.solution, line.created_at)
    contents.found_at[line.solution] = min(earlier, line.created_at)
