"""The facts of a campaign's solves, from which its metrics are made."""

from collections.abc import Iterator
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from core.analysis.facts import CampaignFacts, SolveFacts
from service.db.tables import CampaignRow, JobRow, SearchRow, SolutionRow, SolveRow
from service.spec.search_spec import SearchSpec
from service.store.errors import UnknownRow
from service.store.specs import spec_of

#: Columns that a fact takes over as they are.
FROM_SOLVE = (SolveRow.hop, SolveRow.status, SolveRow.paper, SolveRow.strict, SolveRow.cpu_seconds)
FROM_SOLUTION = (
    SolutionRow.propellant_kg,
    SolutionRow.delta_v_km_s,
    SolutionRow.delta_v_total_km_s,
    SolutionRow.time_of_flight_days,
)


def campaign_facts(session: Session, campaign_id: int) -> CampaignFacts:
    """Return what a campaign has found so far, whether it has ended or not."""
    campaign = session.get(CampaignRow, campaign_id)
    if campaign is None:
        raise UnknownRow("campaign", campaign_id)
    return CampaignFacts(
        id=campaign.id,
        name=campaign.name,
        state=campaign.state,
        rng_seed=campaign.rng_seed,
        problem=spec_of(campaign).problem,
        solves=tuple(_solves(session, campaign)),
        vectors=_vectors(session, campaign),
    )


def _solves(session: Session, campaign: CampaignRow) -> Iterator[SolveFacts]:
    spec = spec_of(campaign)
    searches = [_of_search(search) for search in spec.search]
    cases = [search.outage_sets for search in spec.search]
    query = (
        select(
            SearchRow.position,
            JobRow.case_index,
            JobRow.mapping,
            JobRow.chain,
            JobRow.seed_id,
            SolveRow.solution_id,
            *FROM_SOLVE,
            *FROM_SOLUTION,
        )
        .join(SearchRow, SearchRow.id == SolveRow.search_id)
        .join(JobRow, JobRow.id == SolveRow.job_id)
        .outerjoin(SolutionRow, SolutionRow.id == SolveRow.solution_id)
        .where(SearchRow.campaign_id == campaign.id)
        .order_by(SearchRow.position, JobRow.case_index, JobRow.chain, SolveRow.hop)
    )
    for row in session.execute(query).mappings():
        facts = dict(row)
        position = facts.pop("position")
        yield SolveFacts(**searches[position], outages=cases[position][facts.pop("case_index")], **facts)


def _of_search(search: SearchSpec) -> dict[str, Any]:
    return {
        "search": search.id,
        "seeds_from": search.seeds.full_name if search.seeds else None,
        "strategy": search.strategy,
        "k": search.k,
        "seed_k": search.seed_k,
        "seed_level": search.seeds.tolerance if search.seeds else None,
        "cap_seconds": search.cpu_seconds * (1 + search.k),
    }


def _vectors(session: Session, campaign: CampaignRow) -> dict[str, Any]:
    query = (
        select(SolutionRow.id, SolutionRow.x)
        .join(SolveRow, SolveRow.solution_id == SolutionRow.id)
        .join(SearchRow, SearchRow.id == SolveRow.search_id)
        .where(SearchRow.campaign_id == campaign.id)
    )
    return {solution_id: x for solution_id, x in session.execute(query)}
