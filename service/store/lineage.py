"""Lineage of a solution, and the job that found it."""

from typing import Any

from sqlalchemy import BindParameter, Select, bindparam, func, select
from sqlalchemy.orm import Session

from service.db.tables import (
    AttemptRow,
    CampaignRow,
    CaseRow,
    JobRow,
    ProblemRow,
    ProvenanceRow,
    SearchRow,
    SolutionRow,
    SolveRow,
)
from service.schemas.solution import Child, LineageGraph, Reproduction
from service.store import solutions
from service.store.claims import Turn, message_of, seeds_of
from service.store.errors import UnknownRowError
from workers.messages import HopJob

_SEED: BindParameter[str] = bindparam("seed")
_FINDERS = select(SolveRow.search_id).where(SolveRow.solution_id == _SEED)
#: Searches that name one seed by itself: S(k|k') with no source.
_NAMES_A_SEED = SearchRow.source_id.is_(None) & SearchRow.strategy.contains("|")
#: The cases of the searches that take the seeds of those that found a solution, or a seed by its name.
_FED = (
    select(CaseRow.search_id, CaseRow.position)
    .join(SearchRow, SearchRow.id == CaseRow.search_id)
    .where(SearchRow.source_id.in_(_FINDERS) | _NAMES_A_SEED)
)
# The jobs of a seed are found by their addresses, whose chain is the seed: every part of the unique index is
# given, so that no other job is looked at, and an index on seeds is not needed.
_SOLVES = (
    select()
    .select_from(JobRow)
    .join(SearchRow, SearchRow.id == JobRow.search_id)
    .join(SolveRow, SolveRow.job_id == JobRow.id)
    .where(
        JobRow.search_id.in_(bindparam("searches", expanding=True)),
        JobRow.kind == "map",
        JobRow.case_index.in_(bindparam("cases", expanding=True)),
        JobRow.chain == _SEED,
    )
)
_N_MAPPED = _SOLVES.add_columns(func.count())
_CHILDREN = (
    _SOLVES.add_columns(
        SolutionRow.id,
        SolutionRow.objective_kg,
        SolutionRow.delta_v_km_s,
        SolutionRow.strict,
        ProblemRow.k,
        JobRow.mapping,
        func.min(SearchRow.name).label("search"),
        func.min(SearchRow.strategy).label("strategy"),
    )
    .join(SolutionRow, SolutionRow.id == SolveRow.solution_id)
    .join(ProblemRow, ProblemRow.hash == SolutionRow.problem_hash)
    .where(SolutionRow.id != _SEED)
    .group_by(
        SolutionRow.id,
        SolutionRow.objective_kg,
        SolutionRow.delta_v_km_s,
        SolutionRow.strict,
        ProblemRow.k,
        JobRow.mapping,
    )
)
_IS_OF_ATTEMPT = (AttemptRow.job_id == SolveRow.job_id) & (AttemptRow.attempt == SolveRow.attempt)
_FIRST_FOUND = (
    select(SolutionRow, SolveRow, JobRow, SearchRow, CampaignRow, ProvenanceRow)
    .join(SolveRow, SolveRow.solution_id == SolutionRow.id)
    .join(JobRow, JobRow.id == SolveRow.job_id)
    .join(SearchRow, SearchRow.id == SolveRow.search_id)
    .join(CampaignRow, CampaignRow.id == SearchRow.campaign_id)
    .join(AttemptRow, _IS_OF_ATTEMPT)
    .join(ProvenanceRow, ProvenanceRow.hash == AttemptRow.provenance_hash)
    .where(SolutionRow.id == bindparam("solution"))
    .order_by(SolveRow.id)
    .limit(1)
)
#: Fields of provenance that a reproduction is compared by.
FROM_PROVENANCE = ("code_version", "python_version", "package_versions", "kernel_hashes", "host")


def graph(session: Session, solution_id: str, most: int) -> LineageGraph:
    """Return the seeds behind a solution and so many of the solutions that it seeded, the best first."""
    known = solutions.lineage(session, solution_id)
    fed = session.execute(_FED, {"seed": solution_id}).all()
    searches, cases = ({row[i] for row in fed} for i in (0, 1))
    asked = {"seed": solution_id, "searches": sorted(searches), "cases": sorted(cases)}
    ordered = _CHILDREN.order_by(SolutionRow.objective_kg.desc(), SolutionRow.id, JobRow.mapping)
    found = session.execute(ordered.limit(most), asked).mappings().all()
    children = [Child.model_validate(dict(row)) for row in found]
    n_children = len(children) if len(children) < most else _count(session, _CHILDREN, asked)
    return LineageGraph(
        **known.model_dump(),
        children=children,
        n_children=n_children,
        n_mapped=session.execute(_N_MAPPED, asked).scalar_one(),
        command=f"coastarc solutions reproduce {solution_id}",
    )


def _count(session: Session, query: Select[Any], asked: dict[str, Any]) -> int:
    counted = select(func.count()).select_from(query.subquery())
    return session.execute(counted, asked).scalar_one()


def reproduction(session: Session, solution_id: str) -> Reproduction:
    """Return the job that found a solution first, cut short after the hop that did."""
    found = session.execute(_FIRST_FOUND, {"solution": solution_id}).first()
    if found is None:
        raise UnknownRowError("solution", solution_id)
    solution, solve, row, search, campaign, provenance = found
    turn = Turn(row, solution.problem_hash, search, campaign)
    job = message_of(session, turn, seeds_of(session, [turn]))
    if isinstance(job, HopJob):
        # Hops depend on those before them, not on those after.
        job = job.model_copy(update={"n_hops": solve.hop - job.address.hop + 1})
    return Reproduction(
        id=solution.id,
        problem_hash=solution.problem_hash,
        job=job,
        hop=solve.hop,
        x=list(solution.x),
        status=solve.status,
        cpu_seconds=solve.cpu_seconds,
        **{name: provenance.content[name] for name in FROM_PROVENANCE},
    )
