"""The solutions that may become seeds of a search."""

from typing import Any

from sqlalchemy import ColumnElement, Select, null, select
from sqlalchemy.orm import Session

from core.analysis.distinct import features
from core.problem import Problem, problem_from
from core.search import refined_problem
from service.db.tables import CampaignRow, JobRow, SearchRow, SolutionRow, SolveRow
from service.scheduler.plan import Candidate
from service.spec import SpecError
from service.spec.search_spec import SearchSpec
from service.store.specs import definition_of, search_spec, spec_of
from service.store.tallies import n_solutions, tallies

#: Rows that are fetched at once where not all may be needed.
STEP = 200


def candidates(
    session: Session, campaign: CampaignRow, row: SearchRow, search: SearchSpec, most: int | None = None
) -> list[Candidate]:
    """Return the different solutions of the source of a search, each at its first address.

    With `most` it stops at so many of those that come first, if their order is that of an index.
    """
    assert search.seeds is not None
    if search.seeds.solution is not None:
        return [_named(session, campaign, search, search.seeds.solution)]
    source = session.get_one(SearchRow, row.source_id)
    source_spec = search_spec(session.get_one(CampaignRow, source.campaign_id), source)
    query = _query(source, source_spec, search, most is not None)
    is_ordered = search.seeds.order in (None, "delta_v")
    problem = spec_of(campaign).problem
    cases = source_spec.outage_sets
    found: dict[str, Candidate] = {}
    for key, case, chain, hop, delta_v, time_of_flight, x in session.execute(
        query.execution_options(yield_per=STEP)
    ):
        if key not in found:
            shape = None if x is None else features(problem, x)
            found[key] = Candidate(key, (case, chain, hop), cases[case], delta_v, time_of_flight, shape)
        if is_ordered and len(found) == most:
            break
    return list(found.values())


def n_candidates(session: Session, row: SearchRow, search: SearchSpec) -> int:
    """Return how many candidates there are."""
    assert search.seeds is not None
    if search.seeds.solution is not None:
        return 1
    counted = tallies(session, SearchRow.id == row.source_id).get(row.source_id or 0, {})
    noun = "strict" if search.seeds.tolerance == "strict" else "solution"
    return n_solutions(counted.get(noun, {}), "search")


def _named(session: Session, campaign: CampaignRow, search: SearchSpec, solution_id: str) -> Candidate:
    """Return the one solution that a search names, or raise unless it can be a seed of it."""
    about = f"search {search.id}: seeds.solution"
    row = session.get(SolutionRow, solution_id)
    if row is None:
        raise SpecError(f"{about}: expected a solution of this archive, got {solution_id}")
    problem = problem_from(definition_of(session, row.problem_hash))
    if search.is_refinement:
        problem = _cut_finer(problem, spec_of(campaign).problem.n_segments, about)
    if problem.family != spec_of(campaign).problem.hash:
        raise SpecError(f"{about}: expected one of the same reference problem, got that of another")
    if search.seeds and search.seeds.tolerance == "strict" and not row.strict:
        raise SpecError(f'{about}: expected a strict one, got one of the paper\'s level; tolerance = "paper"')
    if search.seed_k not in (0, problem.k):
        raise SpecError(f"{about}: expected one with {search.seed_k} outages, got {problem.k}")
    # S(k|0) takes its reference alone.
    outages = problem.outages if search.seed_k else ()
    case = tuple((outage.segment, outage.duration_days) for outage in outages)
    return Candidate(row.id, (0, row.id, 0), case, row.delta_v_km_s, row.time_of_flight_days)


def _cut_finer(problem: Problem, n_segments: int, about: str) -> Problem:
    try:
        return refined_problem(problem, n_segments)
    except ValueError as error:
        raise SpecError(f"{about}: {error}") from error


def _query(source: SearchRow, source_spec: SearchSpec, search: SearchSpec, is_cut: bool) -> Select[Any]:
    """Return the query of (id, case, chain, hop, delta-v, time of flight, vector or None)."""
    assert search.seeds is not None
    is_good = SolveRow.strict if search.seeds.tolerance == "strict" else SolveRow.paper
    # Vectors are large, and only one order looks at them.
    x = SolutionRow.x if search.seeds.order == "diversity" else null()
    # Of solves or of jobs, whichever has an index in the order that is wanted.
    mine: ColumnElement[bool] = JobRow.search_id == source.id
    mine &= JobRow.kind == ("hop" if source_spec.seed_k is None else "map")
    order: list[Any] = [JobRow.case_index, JobRow.chain, JobRow.hop, SolveRow.hop]
    if is_cut and search.seeds.order == "delta_v":
        # The most final mass is the least delta-v.
        mine = (SolveRow.search_id == source.id) & SolveRow.solution_id.is_not(None)
        order = [SolveRow.final_mass_kg.desc(), *order]
    return (
        select(SolutionRow.id, JobRow.case_index, JobRow.chain, SolveRow.hop)
        .add_columns(SolutionRow.delta_v_km_s, SolutionRow.time_of_flight_days, x)
        .join(SolveRow, SolveRow.solution_id == SolutionRow.id)
        .join(JobRow, JobRow.id == SolveRow.job_id)
        .where(mine, is_good)
        .order_by(*order)
    )
