"""A campaign, and those that it takes seeds from, as the lines of a portable file.

A portable file as rows, in one transaction: all of it, or nothing.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from sqlalchemy import Row, Select, func, insert, select, text
from sqlalchemy.orm import Session

from service.archive_format.container import CERTIFICATES, Entry, PortableConflictError, digest_of
from service.archive_format.lines import (
    RESTING,
    AttemptLine,
    CampaignLine,
    CertificateLine,
    JobLine,
    Line,
    ProvenanceLine,
    SearchLine,
    SolutionLine,
    SolveLine,
    SourceLine,
)
from service.archive_format.reading import ReadCampaign, ReadFile, kernel_entries, portable_fields
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
    shared_columns,
)
from service.store.cache import spec_of
from service.store.errors import UnknownRowError
from service.store.events import add_event
from service.store.planning import add_cases
from service.store.solutions import ELSEWHERE
from workers.certificate import CertificateContent

#: Rows that are in memory at once, and ids that one query names.
CHUNK, AT_ONCE = 2000, 500

_JOB, _ATTEMPT, _SOLVE = plain(JobRow).c, plain(AttemptRow).c, plain(SolveRow).c
_SEARCH, _SOLUTION, _PROVENANCE = plain(SearchRow).c, plain(SolutionRow).c, plain(ProvenanceRow).c
_CERTIFICATE = plain(CertificateRow).c
#: Columns that a line takes over under their own names.
JOB_COLUMNS = shared_columns(JobRow, JobLine)
ATTEMPT_COLUMNS = shared_columns(AttemptRow, AttemptLine)
SOLVE_COLUMNS = shared_columns(SolveRow, SolveLine, but=("defects",))
SOLUTION_COLUMNS = shared_columns(SolutionRow, SolutionLine, but=("x", "defects"))
CERTIFICATE_COLUMNS = shared_columns(CertificateRow, CertificateLine, but=("content",))


def chain_of_campaigns(session: Session, campaign_id: int) -> list[CampaignRow]:
    """Return a campaign after those that it takes seeds from, and refuse one that is at work."""
    if session.get(CampaignRow, campaign_id) is None:
        raise UnknownRowError("campaign", campaign_id)
    ordered: dict[int, CampaignRow] = {}

    def add(one: int) -> None:
        # A source is older than what it feeds, so this ends.
        source = select(SearchRow.source_id).where(SearchRow.campaign_id == one)
        owners = select(SearchRow.campaign_id).where(SearchRow.id.in_(source)).distinct()
        for owner in sorted(session.scalars(owners)):
            if owner != one and owner not in ordered:
                add(owner)
        ordered[one] = session.get_one(CampaignRow, one)

    add(campaign_id)
    for campaign in ordered.values():
        _require_at_rest(session, campaign)
    return list(ordered.values())


def _require_at_rest(session: Session, campaign: CampaignRow) -> None:
    thing = f"campaign {campaign.id} ({campaign.name})"
    if campaign.state not in RESTING:
        raise PortableConflictError(
            f"{thing}: expected state {', '.join(RESTING[:-1])} or {RESTING[-1]}, got {campaign.state}; "
            "wait for its end, or pause it"
        )
    running = (
        select(func.count())
        .select_from(JobRow)
        .join(SearchRow, SearchRow.id == JobRow.search_id)
        .where(SearchRow.campaign_id == campaign.id, JobRow.state == "running")
    )
    if n_running := session.scalar(running):
        raise PortableConflictError(
            f"{thing}: expected no running jobs, got {n_running}; wait until they have ended"
        )


def entries(session: Session, campaigns: Sequence[CampaignRow]) -> Iterator[Entry]:
    """Yield all entries of a portable file in their order."""
    for number, campaign in enumerate(campaigns):
        yield from campaign_entries(session, campaign, f"campaigns/{number:02d}")
    searches = _searches_to_export(session, campaigns)
    yield "provenance.ndjson", _encode(_provenance_lines(session, searches))
    yield "solutions.ndjson", _encode(_solution_lines(session, searches))
    if (first := next(certificates := _certificate_lines(session, searches), None)) is not None:
        yield CERTIFICATES, _encode(chain([first], certificates))
    for name, path in sorted(kernel_entries([spec_of(campaign) for campaign in campaigns]).items()):
        yield name, [path.read_bytes()]


def campaign_entries(session: Session, campaign: CampaignRow, folder: str) -> Iterator[Entry]:
    """Yield the entries of one campaign; solves name jobs by the lines that come before them."""
    numbers: dict[int, int] = {}
    searches = _searches_to_export(session, [campaign])
    yield f"{folder}/campaign.json", [_campaign(session, campaign).written()]
    yield f"{folder}/jobs.ndjson", _encode(_jobs(session, searches, numbers))
    yield f"{folder}/solves.ndjson", _encode(_solves(session, searches, numbers))


def _encode(lines: Iterable[Line]) -> Iterator[bytes]:
    return (line.written() for line in lines)


def _searches_to_export(session: Session, campaigns: Sequence[CampaignRow]) -> dict[int, int]:
    """Return the positions of searches by their ids."""
    mine = SearchRow.campaign_id.in_([campaign.id for campaign in campaigns])
    return {
        key: position
        for key, position in session.execute(select(SearchRow.id, SearchRow.position).where(mine))
    }


def _campaign(session: Session, campaign: CampaignRow) -> CampaignLine:
    rows = session.scalars(
        select(SearchRow).where(SearchRow.campaign_id == campaign.id).order_by(SearchRow.position)
    )
    return CampaignLine(
        spec_hash=campaign.spec_hash,
        spec=portable_fields(spec_of(campaign)),
        state=campaign.state,
        priority=campaign.priority,
        created_at=campaign.created_at,
        finished_at=campaign.finished_at,
        searches=tuple(_search(session, row) for row in rows),
    )


def _search(session: Session, row: SearchRow) -> SearchLine:
    source = None
    if row.source_id is not None:
        found = session.get_one(SearchRow, row.source_id)
        owner = session.get_one(CampaignRow, found.campaign_id)
        source = SourceLine(campaign=owner.spec_hash, search=found.name)
    return SearchLine(name=row.name, state=row.state, priority=row.priority, weight=row.weight, source=source)


def _chunks(session: Session, query: Select[Any], key: Any) -> Iterator[Sequence[Row[Any]]]:
    """Yield the rows of a query in order of a growing key, some at a time."""
    after: Any = None
    while True:
        page = query if after is None else query.where(key > after)
        rows = session.connection().execute(page.order_by(key).limit(CHUNK)).all()
        if not rows:
            return
        yield rows
        after = getattr(rows[-1], key.name)


def _jobs(session: Session, searches: dict[int, int], numbers: dict[int, int]) -> Iterator[JobLine]:
    query = select(plain(JobRow)).where(_JOB.search_id.in_(searches))
    for rows in _chunks(session, query, _JOB.id):
        attempts = _attempts(session, rows[0].id, rows[-1].id)
        for row in rows:
            numbers[row.id] = len(numbers)
            yield JobLine(
                **_columns(row, JOB_COLUMNS),
                search=searches[row.search_id],
                case=row.case_index,
                seed=row.seed_id,
                attempts=tuple(attempts.get(row.id, ())),
            )


def _attempts(session: Session, first: int, last: int) -> dict[int, list[AttemptLine]]:
    query = (
        select(plain(AttemptRow))
        .where(_ATTEMPT.job_id.between(first, last), _ATTEMPT.ended_at.is_not(None))
        .order_by(_ATTEMPT.job_id, _ATTEMPT.attempt)
    )
    found: dict[int, list[AttemptLine]] = {}
    for row in session.connection().execute(query):
        line = AttemptLine(**_columns(row, ATTEMPT_COLUMNS), provenance=row.provenance_hash)
        found.setdefault(row.job_id, []).append(line)
    return found


def _solves(session: Session, searches: dict[int, int], numbers: dict[int, int]) -> Iterator[SolveLine]:
    query = select(plain(SolveRow)).where(_SOLVE.search_id.in_(searches))
    for rows in _chunks(session, query, _SOLVE.id):
        for row in rows:
            yield SolveLine(
                **_columns(row, SOLVE_COLUMNS),
                job=numbers[row.job_id],
                defects=_with_gaps(row.defects),
                solution=row.solution_id,
            )


def _provenance_lines(session: Session, searches: dict[int, int]) -> Iterator[ProvenanceLine]:
    used = (
        select(_ATTEMPT.provenance_hash)
        .join(plain(JobRow), _JOB.id == _ATTEMPT.job_id)
        .where(_JOB.search_id.in_(searches), _ATTEMPT.ended_at.is_not(None))
    )
    query = select(plain(ProvenanceRow)).where(_PROVENANCE.hash.in_(used))
    for rows in _chunks(session, query, _PROVENANCE.hash):
        yield from (ProvenanceLine(hash=row.hash, content=row.content) for row in rows)


def _solution_lines(session: Session, searches: dict[int, int]) -> Iterator[SolutionLine]:
    query = select(plain(SolutionRow)).where(_SOLUTION.id.in_(_solution_ids(searches)))
    for rows in _chunks(session, query, _SOLUTION.id):
        for row in rows:
            yield SolutionLine(
                **_columns(row, SOLUTION_COLUMNS),
                problem=row.problem_hash,
                x=row.x,
                defects=_with_gaps(row.defects),
            )


def _solution_ids(searches: dict[int, int]) -> Select[Any]:
    return select(_SOLVE.solution_id).where(_SOLVE.search_id.in_(searches), _SOLVE.solution_id.is_not(None))


def _certificate_lines(session: Session, searches: dict[int, int]) -> Iterator[CertificateLine]:
    owner = _CERTIFICATE.solution_id
    is_ours = owner.in_(_solution_ids(searches))
    for owners in _chunks(session, select(owner).where(is_ours).distinct(), owner):
        span = owner.between(owners[0].solution_id, owners[-1].solution_id)
        query = select(plain(CertificateRow)).where(is_ours, span).order_by(owner, _CERTIFICATE.hash)
        for row in session.connection().execute(query):
            # A database may give a whole float back as an integer; the document knows which is which.
            content = CertificateContent.model_validate(row.content).model_dump(mode="json")
            own = _columns(row, CERTIFICATE_COLUMNS)
            yield CertificateLine(**own, solution=row.solution_id, content=content)


def _columns(row: Row[Any], names: Iterable[str]) -> dict[str, Any]:
    return {name: getattr(row, name) for name in names}


def _with_gaps(defects: tuple[float, ...]) -> tuple[float | None, ...]:
    return tuple(value if math.isfinite(value) else None for value in defects)


#: As many as are inserted at once.
Rows = list[dict[str, Any]]
#: Search ids of a campaign by name.
Searches = dict[str, int]


class ImportResult(NamedTuple):
    """What became of a portable file."""

    #: The campaign that was asked for, as it is called here.
    campaign_id: int
    #: Those that are new, by name; none if all were there.
    new_campaigns: list[str]
    n_solves: int
    n_solutions: int
    n_certificates: int


def import_campaigns(session: Session, read: ReadFile, now: float) -> ImportResult:
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
        add_event(session, row.id, "campaign", now, state=row.state)
    # They may have been made since a campaign that is there already came here.
    n_certificates = _add_new(session, CertificateRow, _certificates(read))
    return ImportResult(campaign_id, [row.name for row, _ in new], n_solves, n_solutions, n_certificates)


def _require_same(session: Session, row: CampaignRow, campaign: ReadCampaign, read: ReadFile) -> None:
    for name, content in campaign_entries(session, row, campaign.folder):
        if digest_of(content) != read.unpacked.manifest.members[name]:
            raise PortableConflictError(
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
