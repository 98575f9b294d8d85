"""A portable file as rows, in one transaction: all of it, or nothing."""

import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from sqlalchemy import insert, select, text
from sqlalchemy.orm import Session

from service.archive_format.container import PortableConflict, digest_of
from service.archive_format.lines import JobLine
from service.archive_format.reading import ReadCampaign, ReadFile
from service.db.dialect import INSERTS, fill_tallies_of, plain
from service.db.tables import (
    AttemptRow,
    Base,
    CampaignRow,
    CertificateRow,
    JobRow,
    ProvenanceRow,
    SearchRow,
    SeedLinkRow,
    SolutionRow,
    SolveRow,
)
from service.store.certificates import ELSEWHERE
from service.store.events import note
from service.store.portable_rows import (
    ATTEMPT_COLUMNS,
    CERTIFICATE_COLUMNS,
    JOB_COLUMNS,
    SOLUTION_COLUMNS,
    SOLVE_COLUMNS,
    campaign_entries,
)
from service.store.submission import add_cases

#: As many as are inserted at once.
Rows = list[dict[str, Any]]
#: Search ids of a campaign by name.
Searches = dict[str, int]


class TakenIn(NamedTuple):
    """What became of a portable file."""

    #: The campaign that was asked for, as it is called here.
    campaign_id: int
    #: Those that are new, by name; none if all were there.
    new_campaigns: list[str]
    n_solves: int
    n_solutions: int
    n_certificates: int


def take_in(session: Session, read: ReadFile, now: float) -> TakenIn:
    """Store what of a file is not there yet; a campaign that is there already must be the same."""
    known: dict[str, Searches] = {}
    new: list[tuple[CampaignRow, ReadCampaign]] = []
    campaign_id = 0
    for campaign in read.campaigns:
        row = session.scalar(select(CampaignRow).where(CampaignRow.spec_hash == campaign.line.spec_hash))
        if row is None:
            row = _add_campaign(session, campaign, known)
            new.append((row, campaign))
        else:
            _require_same(session, row, campaign, read)
        known[campaign.line.spec_hash] = _searches_of(session, row)
        campaign_id = row.id
    n_solves = n_solutions = 0
    if new:
        _add_new(session, ProvenanceRow, _provenances(read))
        n_solutions = _add_new(session, SolutionRow, _solutions(read))
    for row, campaign in new:
        n_solves += _add_work(session, row, campaign, read)
        note(session, row.id, "campaign", now, state=row.state)
    # They may have been made since a campaign that is there already came here.
    n_certificates = _add_new(session, CertificateRow, _certificates(read))
    return TakenIn(campaign_id, [row.name for row, _ in new], n_solves, n_solutions, n_certificates)


def _require_same(session: Session, row: CampaignRow, campaign: ReadCampaign, read: ReadFile) -> None:
    for name, content in campaign_entries(session, row, campaign.folder):
        if digest_of(content) != read.unpacked.manifest.members[name]:
            raise PortableConflict(
                f"campaign {row.name}: expected none here, or the same as in the file, got campaign {row.id} "
                f"with other work; take the file in elsewhere with --data"
            )


def _add_campaign(session: Session, campaign: ReadCampaign, known: dict[str, Searches]) -> CampaignRow:
    line, spec = campaign.line, campaign.spec
    row = CampaignRow(
        name=spec.campaign.name,
        spec_hash=line.spec_hash,
        spec=spec.as_fields(),
        rng_seed=spec.campaign.rng_seed,
        state=line.state,
        priority=line.priority,
        created_at=line.created_at,
        finished_at=line.finished_at,
    )
    session.add(row)
    session.flush()
    own: Searches = {}
    for position, search in spec.in_order:
        own[search.id] = _add_search(session, row, campaign, position, known | {line.spec_hash: own})
    return row


def _add_search(
    session: Session, owner: CampaignRow, campaign: ReadCampaign, position: int, known: dict[str, Searches]
) -> int:
    line, spec = campaign.line.searches[position], campaign.spec.search[position]
    source = line.source
    row = SearchRow(
        campaign_id=owner.id,
        position=position,
        name=line.name,
        strategy=spec.strategy,
        source_id=None if source is None else known[source.campaign][source.search],
        state=line.state,
        priority=line.priority,
        weight=line.weight,
    )
    session.add(row)
    session.flush()
    add_cases(session, row, campaign.spec.problems_of(spec))
    return row.id


def _searches_of(session: Session, row: CampaignRow) -> Searches:
    query = select(SearchRow.name, SearchRow.id).where(SearchRow.campaign_id == row.id)
    return {name: key for name, key in session.execute(query)}


def _provenances(read: ReadFile) -> Iterator[Rows]:
    for lines in read.provenances():
        yield [{"hash": line.hash, "content": line.content} for line in lines]


def _solutions(read: ReadFile) -> Iterator[Rows]:
    for lines in read.solutions():
        yield [
            {name: getattr(line, name) for name in SOLUTION_COLUMNS}
            | {
                "problem_hash": line.problem,
                "x": np.array(line.x),
                "defects": np.array(line.defects, dtype=np.float64),
                "created_at": read.contents.found_at[line.id],
            }
            for line in lines
        ]


def _certificates(read: ReadFile) -> Iterator[Rows]:
    for lines in read.certificates():
        yield [
            {name: getattr(line, name) for name in CERTIFICATE_COLUMNS}
            | {
                "solution_id": line.solution,
                "basis": ELSEWHERE,
                "level": line.content["level"],
                "is_sound": line.content["is_sound"],
                "content": line.content,
            }
            for line in lines
        ]


def _add_work(session: Session, row: CampaignRow, campaign: ReadCampaign, read: ReadFile) -> int:
    """Store jobs, attempts and solves of a new campaign, and what is counted of them."""
    names = [search.name for search in campaign.line.searches]
    ids = [_searches_of(session, row)[name] for name in names]
    jobs = _add_jobs(session, ids, read.jobs(campaign))
    n_solves, spent = 0, {search_id: [0.0] for search_id in ids}
    for lines in read.solves(campaign):
        rows = []
        for line in lines:
            job_id, search_id, _, _ = jobs[line.job]
            found = None if line.solution is None else read.contents.solutions[line.solution]
            spent[search_id].append(line.cpu_seconds)
            rows.append(
                {name: getattr(line, name) for name in SOLVE_COLUMNS}
                | {
                    "job_id": job_id,
                    "search_id": search_id,
                    "defects": np.array(line.defects, dtype=np.float64),
                    "solution_id": line.solution,
                    "final_mass_kg": found and found[1],
                }
            )
        session.connection().execute(insert(plain(SolveRow)), rows)
        n_solves += len(rows)
        _add_new(session, SeedLinkRow, [list(_links(lines, jobs))])
    _count(session, ids, jobs, spent)
    return n_solves


class _Job(NamedTuple):
    """A job that has been stored."""

    id: int
    search_id: int
    seed: str | None
    mapping: str | None


def _add_jobs(session: Session, ids: list[int], batches: Iterable[list[JobLine]]) -> list[_Job]:
    stored: list[_Job] = []
    statement = insert(plain(JobRow)).returning(plain(JobRow).c.id, sort_by_parameter_order=True)
    for some in batches:
        rows = [
            {name: getattr(line, name) for name in JOB_COLUMNS}
            | {"search_id": ids[line.search], "case_index": line.case, "seed_id": line.seed}
            for line in some
        ]
        keys = session.connection().execute(statement, rows).scalars().all()
        attempts = [
            {name: getattr(attempt, name) for name in ATTEMPT_COLUMNS}
            | {"job_id": key, "provenance_hash": attempt.provenance}
            for key, line in zip(keys, some, strict=True)
            for attempt in line.attempts
        ]
        if attempts:
            session.connection().execute(insert(plain(AttemptRow)), attempts)
        for key, line in zip(keys, some, strict=True):
            stored.append(_Job(key, ids[line.search], line.seed, line.mapping))
    return stored


def _links(lines: list[Any], jobs: list[_Job]) -> Iterator[dict[str, Any]]:
    for line in lines:
        job = jobs[line.job]
        if line.solution is not None and job.seed not in (None, line.solution):
            yield {"solution_id": line.solution, "seed_id": job.seed, "mapping": job.mapping}


def _count(session: Session, ids: list[int], jobs: list[_Job], spent: dict[int, list[float]]) -> None:
    for search_id in ids:
        row = session.get_one(SearchRow, search_id)
        row.n_planned = sum(job.search_id == search_id for job in jobs)
        row.n_solves = len(spent[search_id]) - 1
        row.cpu_seconds = math.fsum(spent[search_id])
    session.flush()
    session.execute(text(fill_tallies_of(ids)))


def _add_new(session: Session, table: type[Base], batches: Iterable[Rows]) -> int:
    """Insert rows whose keys are not taken; return how many."""
    session.flush()
    connection = session.connection()
    statement = INSERTS[connection.dialect.name](plain(table)).on_conflict_do_nothing()
    statement = statement.returning(*plain(table).primary_key)
    return sum(len(connection.execute(statement, rows).all()) for rows in batches if rows)
