"""Solutions as records: found by whom, from which seed, and certified how."""

from typing import Any, NamedTuple

import numpy as np
from sqlalchemy import ColumnElement, ScalarSelect, func, select, true
from sqlalchemy.orm import Session, aliased

from service.api.schemas import (
    Lineage,
    LineageEdge,
    LineageNode,
    OutageView,
    Record,
    RecordPage,
    RecordWithVector,
)
from service.db.tables import (
    AttemptRow,
    CampaignRow,
    JobRow,
    ProblemRow,
    ProvenanceRow,
    SearchRow,
    SeedLinkRow,
    SolutionRow,
    SolveRow,
)
from service.store.errors import StoreError, UnknownRow

#: Columns that a record shows under their own name.
FROM_SOLUTION = (
    "id",
    "problem_hash",
    "objective_kg",
    "propellant_kg",
    "delta_v_km_s",
    "delta_v_total_km_s",
    "shooting_days",
    "initial_coast_days",
    "final_coast_days",
    "time_of_flight_days",
    "insertion_epoch",
    "arrival_epoch",
    "paper",
    "strict",
    "created_at",
)
FROM_SOLVE = ("status", "n_iterations", "n_evaluations", "cpu_seconds", "wall_seconds", "rng_key")


#: Solves beside the one that a record shows.
_Again = aliased(SolveRow)
#: Solves among which a page is looked for.
_Next, _Each, _Listed = aliased(SolveRow), aliased(SolveRow), aliased(SolutionRow)


class _Found(NamedTuple):
    """All that a record is made from, in the order of the query's entities."""

    solution: SolutionRow
    solve: SolveRow
    job: JobRow
    search: SearchRow
    campaign: CampaignRow
    problem: ProblemRow
    provenance: ProvenanceRow


class Filter:
    """Which solutions are asked for; what is None does not restrict."""

    def __init__(
        self, campaign: int | None = None, search: str | None = None, strict: bool | None = None
    ) -> None:
        self.campaign = campaign
        self.search = search
        self.strict = strict

    @property
    def is_of_searches(self) -> bool:
        """Whether it names some searches; without, all solutions there are stand in one order."""
        return self.campaign is not None or self.search is not None

    @property
    def searches(self) -> ColumnElement[bool]:
        """The searches that it admits."""
        wanted: ColumnElement[bool] = true()
        if self.campaign is not None:
            wanted &= SearchRow.campaign_id == self.campaign
        if self.search is not None:
            wanted &= SearchRow.name == self.search
        return wanted

    def first_solve(self, of: Any, solution_id: Any) -> ScalarSelect[int]:
        """Return the first solve inside the filter that found a solution, which `of` around it names."""
        query = (
            select(func.min(_Again.id))
            .join(SearchRow, SearchRow.id == _Again.search_id)
            .where(_Again.solution_id == solution_id, self.searches)
        )
        if self.strict is not None:
            query = query.where(_Again.strict == self.strict)
        return query.correlate(of).scalar_subquery()


def list_records(session: Session, wanted: Filter, limit: int, after: str | None) -> RecordPage:
    """Return a page of solutions, the most final mass first."""
    mark = None if after is None else _read_mark(after)
    query = _records(wanted).order_by(SolutionRow.objective_kg.desc(), SolutionRow.id).limit(limit + 1)
    if mark is not None:
        query = query.where(_follows(mark, SolutionRow.objective_kg, SolutionRow.id))
    if wanted.is_of_searches:
        query = query.where(SolveRow.id.in_(_next_of_each(wanted, limit + 1, mark)))
    else:
        query = query.where(SolutionRow.id.in_(_next_of_all(wanted, limit + 1, mark)))
    found = _found(session, query)
    records = [_record(row) for row in found[:limit]]
    has_more = len(found) > limit
    return RecordPage(items=records, next=_mark(records[-1]) if has_more else None)


def get_record(session: Session, solution_id: str) -> RecordWithVector:
    """Return a solution with its vector, as it was first found."""
    found = _found(session, _records(Filter()).where(SolutionRow.id == solution_id))
    if not found:
        raise UnknownRow("solution", solution_id)
    return _with_vector(found[0])


def all_records(session: Session, wanted: Filter, limit: int | None) -> list[RecordWithVector]:
    """Return the solutions of a filter with their vectors, the most final mass first."""
    query = _records(wanted).order_by(SolutionRow.objective_kg.desc(), SolutionRow.id).limit(limit)
    return [_with_vector(row) for row in _found(session, query)]


def page_by_id(session: Session, wanted: Filter, after: str, limit: int) -> list[RecordWithVector]:
    """Return the solutions that follow an id, with their vectors; quick however many there are."""
    query = _records(wanted).where(SolutionRow.id > after).order_by(SolutionRow.id).limit(limit)
    return [_with_vector(row) for row in _found(session, query)]


def _with_vector(row: _Found) -> RecordWithVector:
    shown = _record(row).model_dump()
    return RecordWithVector(**shown, x=row.solution.x.tolist(), verification=row.solution.verification)


def find_id(session: Session, prefix: str) -> str:
    """Return the id of the one solution that begins with a prefix, as a user types it."""
    query = select(SolutionRow.id).where(SolutionRow.id.startswith(prefix, autoescape=True)).limit(2)
    found = session.scalars(query).all()
    if not found:
        raise UnknownRow("solution", prefix)
    if len(found) > 1:
        raise StoreError(
            f"solution {prefix}: expected the beginning of one id, got that of several; type more of it"
        )
    return found[0]


def definition_and_vector(session: Session, solution_id: str) -> tuple[dict[str, Any], np.ndarray[Any, Any]]:
    """Return the problem of a solution as plain data, and its vector."""
    solution = session.get(SolutionRow, solution_id)
    if solution is None:
        raise UnknownRow("solution", solution_id)
    return session.get_one(ProblemRow, solution.problem_hash).definition, solution.x


def lineage(session: Session, solution_id: str) -> Lineage:
    """Return all seeds behind a solution, and the seeds of those."""
    if session.get(SolutionRow, solution_id) is None:
        raise UnknownRow("solution", solution_id)
    links: list[SeedLinkRow] = []
    known, fresh = {solution_id}, {solution_id}
    while fresh:
        found = session.scalars(select(SeedLinkRow).where(SeedLinkRow.solution_id.in_(fresh))).all()
        links.extend(found)
        fresh = {link.seed_id for link in found} - known
        known |= fresh
    rows = _found(session, _records(Filter()).where(SolutionRow.id.in_(known)))
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


def _records(wanted: Filter) -> Any:
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
        .where(SolveRow.id == wanted.first_solve(SolutionRow, SolutionRow.id))
    )


def _found(session: Session, query: Any) -> list[_Found]:
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
        seed_id=job.seed_id,
        mapping=job.mapping,
        campaign_id=campaign.id,
        search_id=search.id,
        search=search.name,
        strategy=search.strategy,
        k=problem.k,
        outages=[OutageView(**outage) for outage in problem.definition["outages"]],
        defects_solved=solve.defects.reshape(-1, 7).tolist(),
        defects_verified=solution.defects.reshape(-1, 7).tolist(),
    )


def _next_of_each(wanted: Filter, number: int, mark: tuple[float, str] | None) -> Any:
    """Return the next solves of each search in its own order, among which are the next of all of them.

    A search lists its solutions by an index; the whole archive would have to be sorted for one of its pages.
    """
    following = (
        select(_Next.id)
        .where(
            _Next.search_id == SearchRow.id,
            _Next.solution_id.is_not(None),
            _Next.id == wanted.first_solve(_Next, _Next.solution_id),
        )
        .order_by(_Next.final_mass_kg.desc(), _Next.solution_id)
        .limit(number)
    )
    if mark is not None:
        following = following.where(_follows(mark, _Next.final_mass_kg, _Next.solution_id))
    if wanted.strict is not None:
        following = following.where(_Next.strict == wanted.strict)
    following = following.correlate(SearchRow)
    return select(_Each.id).select_from(SearchRow).join(_Each, _Each.id.in_(following)).where(wanted.searches)


def _next_of_all(wanted: Filter, number: int, mark: tuple[float, str] | None) -> Any:
    """Return the next solutions of the archive."""
    following = select(_Listed.id).order_by(_Listed.objective_kg.desc(), _Listed.id).limit(number)
    if wanted.strict is not None:
        following = following.where(_Listed.strict == wanted.strict)
    return following if mark is None else following.where(_follows(mark, _Listed.objective_kg, _Listed.id))


def _follows(mark: tuple[float, str], mass: Any, key: Any) -> Any:
    """Return whether a solution comes after the last one of a page."""
    # The first part says less than the second, and can be looked up.
    return (mass <= mark[0]) & ((mass < mark[0]) | (key > mark[1]))


def _mark(record: Record) -> str:
    # Hexadecimal keeps every bit of the float, which the next page's comparison needs.
    return f"{record.objective_kg.hex()}_{record.id}"


def _read_mark(text: str) -> tuple[float, str]:
    number, _, key = text.partition("_")
    try:
        return float.fromhex(number), key
    except (ValueError, OverflowError) as error:
        raise StoreError(f"after: expected the `next` of a page, got {text!r}") from error
