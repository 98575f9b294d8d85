"""The solutions that may become seeds of a search."""

from sqlalchemy import null, select
from sqlalchemy.orm import Session

from core.analysis.distinct import features
from service.db.tables import CampaignRow, JobRow, SearchRow, SolutionRow, SolveRow
from service.scheduler.plan import Candidate
from service.search_spec import SearchSpec
from service.store.specs import search_spec, spec_of


def candidates(
    session: Session, campaign: CampaignRow, row: SearchRow, search: SearchSpec
) -> list[Candidate]:
    """Return the different solutions of the source of a search, each at its first address."""
    seeds = search.seeds
    assert seeds is not None
    is_good = SolveRow.strict if seeds.tolerance == "strict" else SolveRow.paper
    # Vectors are large, and only one order looks at them.
    x = SolutionRow.x if seeds.order == "diversity" else null()
    query = (
        select(SolutionRow.id, JobRow.case_index, JobRow.chain, SolveRow.hop)
        .add_columns(SolutionRow.delta_v_km_s, SolutionRow.time_of_flight_days, x)
        .join(SolveRow, SolveRow.solution_id == SolutionRow.id)
        .join(JobRow, JobRow.id == SolveRow.job_id)
        .where(SolveRow.search_id == row.source_id, is_good)
        .order_by(JobRow.case_index.desc(), JobRow.chain.desc(), SolveRow.hop.desc())
    )
    problem = spec_of(campaign).problem
    source = session.get_one(SearchRow, row.source_id)
    cases = search_spec(session.get_one(CampaignRow, source.campaign_id), source).outage_sets
    found: dict[str, Candidate] = {}
    for key, case, chain, hop, delta_v, time_of_flight, vector in session.execute(query):
        shape = None if vector is None else features(problem, vector)
        found[key] = Candidate(key, (case, chain, hop), cases[case], delta_v, time_of_flight, shape)
    return list(found.values())
