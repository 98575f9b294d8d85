"""Solutions as records, their certificates, and the missed-thrust analyses that were made of them."""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, NamedTuple

from sqlalchemy import not_, or_, select
from sqlalchemy.orm import Session

from core.analysis.campaign_facts import CampaignFacts
from core.problem import Problem, problem_from
from service.db.engine import Database
from service.db.tables import (
    AttemptRow,
    CampaignRow,
    CertificateRow,
    JobRow,
    ProblemRow,
    ProvenanceRow,
    SearchRow,
    SeedLinkRow,
    SolutionRow,
    SolveRow,
    shared_columns,
)
from service.schemas.problem import OutageView
from service.schemas.solution import (
    Filter,
    Lineage,
    LineageEdge,
    LineageNode,
    Record,
    RecordInFull,
    RecordPage,
    RecordWithVector,
)
from service.spec.missed_thrust import analysis_name
from service.spec.search_spec import SearchSpec
from service.store.cache import spec_of
from service.store.errors import StoreError, UnknownRowError
from service.store.filters import Begin, Order, Wanted, ids_of_page
from service.store.statistics import campaign_facts
from workers.certificate import CertificateContent, CertificateDocument

#: The basis of a certificate that was taken in from another installation, until it is found again here.
ELSEWHERE = ""


class Subject(NamedTuple):
    """A solution that is to be certified."""

    id: str
    definition: dict[str, Any]
    x: tuple[float, ...]
    #: What it was verified at when it was stored.
    level: str


class Certificates:
    """The certificates of an archive; every call is one transaction."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, document: CertificateDocument, basis: str) -> bool:
        """Store a certificate, or that the same one was found again; return whether it is new."""
        return self._database.write(lambda session: _add(session, document, basis))

    def latest(self, solution_id: str) -> CertificateDocument | None:
        """Return the certificate of a solution that was found last, or None where it has none."""
        with self._database.read() as session:
            return _latest(session, solution_id)

    def ids(self, wanted: Filter) -> list[str]:
        """Return the solutions that a filter leaves to be certified, the most final mass first."""
        with self._database.read() as session:
            return ids_of_page(session, wanted, Order(), Begin(), None)[0]

    def subject(self, solution_id: str) -> Subject:
        """Return what is certified about a solution."""
        with self._database.read() as session:
            return _subject(session, solution_id)

    def sound_on(self, basis: str) -> set[str]:
        """Return the solutions found sound, and no worse than archived, on a basis."""
        is_no_worse = or_(CertificateRow.level == "strict", not_(SolutionRow.strict))
        found = (
            select(CertificateRow.solution_id)
            .join(SolutionRow, SolutionRow.id == CertificateRow.solution_id)
            .where(CertificateRow.basis == basis, CertificateRow.is_sound, is_no_worse)
        )
        with self._database.read() as session:
            return set(session.scalars(found))


def _subject(session: Session, solution_id: str) -> Subject:
    row = _solution(session, solution_id)
    level = "strict" if row.strict else "paper" if row.paper else "none"
    return Subject(row.id, session.get_one(ProblemRow, row.problem_hash).definition, row.x, level)


def _add(session: Session, document: CertificateDocument, basis: str) -> bool:
    content = document.content
    known = session.get(CertificateRow, (content.solution_id, document.hash))
    if known is not None:
        known.basis, known.checked_at = basis, document.checked_at.timestamp()
        return False
    row = CertificateRow(
        solution_id=content.solution_id,
        hash=document.hash,
        basis=basis,
        level=content.level,
        is_sound=content.is_sound,
        content=content.model_dump(mode="json"),
        made_on=document.made_on,
        made_at=document.made_at.timestamp(),
        cpu_seconds=document.cpu_seconds,
        checked_at=document.checked_at.timestamp(),
    )
    session.add(row)
    return True


def latest_row(session: Session, solution_id: str) -> CertificateRow | None:
    """Return the certificate of a solution that was found last."""
    own = select(CertificateRow).where(CertificateRow.solution_id == solution_id)
    return session.scalar(own.order_by(CertificateRow.checked_at.desc(), CertificateRow.hash).limit(1))


def _latest(session: Session, solution_id: str) -> CertificateDocument | None:
    _solution(session, solution_id)
    row = latest_row(session, solution_id)
    if row is None:
        return None
    return CertificateDocument(
        content=CertificateContent.model_validate(row.content),
        hash=row.hash,
        made_at=datetime.fromtimestamp(row.made_at, UTC),
        made_on=row.made_on,
        cpu_seconds=row.cpu_seconds,
        checked_at=datetime.fromtimestamp(row.checked_at, UTC),
        is_from_elsewhere=row.basis == ELSEWHERE,
    )


def _solution(session: Session, solution_id: str) -> SolutionRow:
    row = session.get(SolutionRow, solution_id)
    if row is None:
        raise UnknownRowError("solution", solution_id)
    return row


#: Columns that a record shows under their own name.
FROM_SOLUTION = shared_columns(SolutionRow, Record)
FROM_SOLVE = shared_columns(SolveRow, Record, but=(*FROM_SOLUTION, "search_id"))
#: Ids that one query names.
AT_ONCE = 500


class _Found(NamedTuple):
    """All that a record is made from, in the order of the query's entities."""

    solution: SolutionRow
    solve: SolveRow
    job: JobRow
    search: SearchRow
    campaign: CampaignRow
    problem: ProblemRow
    provenance: ProvenanceRow


def list_records(
    session: Session, wanted: Filter, order: Order, begin: Begin, limit: int | None
) -> RecordPage:
    """Return a page of solutions."""
    ids, following = ids_of_page(session, wanted, order, begin, limit)
    found = _query_row(session, _records(session, wanted).where(SolutionRow.id.in_(ids)))
    records = {row.solution.id: _record(row) for row in found}
    return RecordPage(items=[records[key] for key in ids], next=following)


def get_record(session: Session, solution_id: str) -> RecordInFull:
    """Return a solution with its vector, as it was first found."""
    found = _query_row(session, _records(session, Filter()).where(SolutionRow.id == solution_id))
    if not found:
        raise UnknownRowError("solution", solution_id)
    certificate = latest_row(session, solution_id)
    return RecordInFull(
        **_with_vector(found[0]).model_dump(), certificate_hash=certificate.hash if certificate else None
    )


def all_records(session: Session, wanted: Filter, order: Order, limit: int | None) -> list[RecordWithVector]:
    """Return the solutions of a filter with their vectors, all or the first so many."""
    ids, _ = ids_of_page(session, wanted, order, Begin(), limit)
    query = _records(session, wanted)
    found = [
        row
        for start in range(0, len(ids), AT_ONCE)
        for row in _query_row(session, query.where(SolutionRow.id.in_(ids[start : start + AT_ONCE])))
    ]
    place = {key: i for i, key in enumerate(ids)}
    return [_with_vector(row) for row in sorted(found, key=lambda row: place[row.solution.id])]


def page_by_id(session: Session, wanted: Filter, after: str, limit: int) -> list[RecordWithVector]:
    """Return the solutions that follow an id, with their vectors; quick however many there are."""
    query = _records(session, wanted).where(SolutionRow.id > after).order_by(SolutionRow.id).limit(limit)
    return [_with_vector(row) for row in _query_row(session, query)]


def _with_vector(row: _Found) -> RecordWithVector:
    shown = _record(row).model_dump()
    return RecordWithVector(**shown, x=list(row.solution.x), verification=row.solution.verification)


def find_id(session: Session, prefix: str) -> str:
    """Return the id of the one solution that begins with a prefix, as a user types it."""
    query = select(SolutionRow.id).where(SolutionRow.id.startswith(prefix, autoescape=True)).limit(2)
    found = session.scalars(query).all()
    if not found:
        raise UnknownRowError("solution", prefix, "none with this id")
    if len(found) > 1:
        raise StoreError(
            f"solution {prefix}: expected the beginning of one id, got that of several; type more of it"
        )
    return found[0]


def definition_and_vector(session: Session, solution_id: str) -> tuple[dict[str, Any], tuple[float, ...]]:
    """Return the problem of a solution as plain data, and its vector."""
    solution = session.get(SolutionRow, solution_id)
    if solution is None:
        raise UnknownRowError("solution", solution_id)
    return session.get_one(ProblemRow, solution.problem_hash).definition, solution.x


def lineage(session: Session, solution_id: str) -> Lineage:
    """Return all seeds behind a solution, and the seeds of those."""
    if session.get(SolutionRow, solution_id) is None:
        raise UnknownRowError("solution", solution_id)
    links: list[SeedLinkRow] = []
    known, fresh = {solution_id}, {solution_id}
    while fresh:
        found = session.scalars(select(SeedLinkRow).where(SeedLinkRow.solution_id.in_(fresh))).all()
        links.extend(found)
        fresh = {link.seed_id for link in found} - known
        known |= fresh
    rows = _query_row(session, _records(session, Filter()).where(SolutionRow.id.in_(known)))
    edges = [LineageEdge(seed_id=o.seed_id, solution_id=o.solution_id, mapping=o.mapping) for o in links]
    return Lineage(id=solution_id, nodes=sorted(map(_node, rows), key=lambda node: -node.k), edges=edges)


def _node(row: _Found) -> LineageNode:
    return LineageNode(
        id=row.solution.id,
        search=row.search.name,
        strategy=row.search.strategy,
        k=row.problem.k,
        delta_v_km_s=row.solution.delta_v_km_s,
        strict=row.solution.strict,
    )


def _records(session: Session, wanted: Filter) -> Any:
    asked = Wanted(session, wanted)
    is_of_attempt = (AttemptRow.job_id == SolveRow.job_id) & (AttemptRow.attempt == SolveRow.attempt)
    return (
        select(SolutionRow, SolveRow, JobRow, SearchRow, CampaignRow, ProblemRow, ProvenanceRow)
        .join(SolveRow, SolveRow.solution_id == SolutionRow.id)
        .join(JobRow, JobRow.id == SolveRow.job_id)
        .join(SearchRow, SearchRow.id == SolveRow.search_id)
        .join(CampaignRow, CampaignRow.id == SearchRow.campaign_id)
        .join(ProblemRow, ProblemRow.hash == SolutionRow.problem_hash)
        .join(AttemptRow, is_of_attempt)
        .join(ProvenanceRow, ProvenanceRow.hash == AttemptRow.provenance_hash)
        .where(SolveRow.id == asked.first_solve(), *asked.conditions())
    )


def _query_row(session: Session, query: Any) -> list[_Found]:
    return [_Found(*row) for row in session.execute(query)]


def _record(row: _Found) -> Record:
    solution, solve, job, search, campaign, problem, provenance = row
    return Record(
        **{name: getattr(solution, name) for name in FROM_SOLUTION},
        **{name: getattr(solve, name) for name in FROM_SOLVE},
        **{
            name: provenance.content[name]
            for name in ("code_version", "package_versions", "kernel_hashes", "host")
        },
        **_verification_facts(solution.verification),
        seed_id=job.seed_id,
        mapping=job.mapping,
        campaign_id=campaign.id,
        search_id=search.id,
        search=search.name,
        strategy=search.strategy,
        k=problem.k,
        outages=[OutageView(**outage) for outage in problem.definition["outages"]],
        defects_solved=_states(solve.defects),
        defects_verified=_states(solution.defects),
    )


def _states(defects: tuple[float, ...]) -> list[list[float]]:
    """Return the defects of each trajectory."""
    return [list(defects[start : start + 7]) for start in range(0, len(defects), 7)]


def _verification_facts(verification: dict[str, Any]) -> dict[str, Any]:
    """Return what the verifier says besides its level; earlier versions and imports may say nothing."""
    lowest, is_marginal = verification.get("lowest_km"), verification.get("is_marginal")
    altitudes = lowest if isinstance(lowest, dict) else {}
    named = {"earth_altitude_km": altitudes.get("Earth"), "moon_altitude_km": altitudes.get("Moon")}
    numbers = {name: value if isinstance(value, float | int) else None for name, value in named.items()}
    return numbers | {"is_marginal": is_marginal if isinstance(is_marginal, bool) else None}


@dataclass(frozen=True, slots=True, eq=False)
class MissedThrustAnalysis:
    """A solution and what its analysis has found so far."""

    solution_id: str
    problem: Problem
    x: tuple[float, ...]
    facts: CampaignFacts


def find_analyses(
    session: Session, solution_id: str, campaign_id: int | None = None, limit: int = 1
) -> list[MissedThrustAnalysis]:
    """Return the newest analyses of a solution, or that of one campaign."""
    definition, x = definition_and_vector(session, solution_id)
    named = select(CampaignRow).where(CampaignRow.name == analysis_name(solution_id))
    if campaign_id is not None:
        named = named.where(CampaignRow.id == campaign_id)
    found = [
        MissedThrustAnalysis(solution_id, problem_from(definition), x, campaign_facts(session, campaign.id))
        for campaign in session.scalars(named.order_by(CampaignRow.id.desc()).limit(limit))
        if _is_of(spec_of(campaign).search[0], solution_id)
    ]
    return [one for one in found if one.facts.solves]


def _is_of(search: SearchSpec, solution_id: str) -> bool:
    """Return whether a search analyses a solution: anybody may give a campaign such a name."""
    return search.reference == "frozen" and search.seeds is not None and search.seeds.solution == solution_id
