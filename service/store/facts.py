"""The facts of a campaign's solves, from which its metrics are made."""

from collections.abc import Iterator
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from core.analysis.facts import CampaignFacts, SolveFacts
from service.db.tables import CampaignRow, JobRow, SearchRow, SolutionRow, SolveRow
from service.spec.search_spec import SearchSpec
from service.store.errors import UnknownRow
from service.store.specs import spec_of

#: Columns that a fact takes over as they are.
FROM_JOB = (JobRow.mapping, JobRow.chain, JobRow.seed_id)
FROM_SOLVE = (
    SolveRow.solution_id,
    SolveRow.hop,
    SolveRow.status,
    SolveRow.paper,
    SolveRow.strict,
    SolveRow.cpu_seconds,
)
FROM_SOLUTION = (
    SolutionRow.propellant_kg,
    SolutionRow.delta_v_km_s,
    SolutionRow.delta_v_total_km_s,
    SolutionRow.time_of_flight_days,
)


def campaign_facts(session: Session, campaign_id: int, most_vectors: int | None = None) -> CampaignFacts:
    """Return what a campaign has found so far, whether it has ended or not.

    The vectors of its solutions are left out where they are more than `most_vectors`.
    """
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
        vectors=_vectors(session, campaign, most_vectors),
    )


def _solves(session: Session, campaign: CampaignRow) -> Iterator[SolveFacts]:
    spec = spec_of(campaign)
    searches = [_of_search(search) for search in spec.search]
    cases = [search.outage_sets for search in spec.search]
    query = (
        select(SearchRow.position, JobRow.case_index, *FROM_JOB, *FROM_SOLVE, *FROM_SOLUTION)
        .join(SearchRow, SearchRow.id == SolveRow.search_id)
        .join(JobRow, JobRow.id == SolveRow.job_id)
        .outerjoin(SolutionRow, SolutionRow.id == SolveRow.solution_id)
        .where(SearchRow.campaign_id == campaign.id)
        .order_by(SearchRow.position, JobRow.case_index, JobRow.chain, SolveRow.hop)
    )
    names = [column.key for column in (*FROM_JOB, *FROM_SOLVE, *FROM_SOLUTION)]
    # Past the session, whose own loading takes longer than all the rest.
    for position, case, *values in session.connection().execute(query):
        facts = dict(zip(names, values, strict=True))
        yield SolveFacts(**searches[position], outages=cases[position][case], **facts)


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


def _vectors(session: Session, campaign: CampaignRow, most: int | None) -> dict[str, Any]:
    of_campaign = (
        select(SolveRow.solution_id)
        .join(SearchRow, SearchRow.id == SolveRow.search_id)
        .where(SearchRow.campaign_id == campaign.id, SolveRow.solution_id.is_not(None))
    )
    if most is not None:
        some = of_campaign.distinct().limit(most + 1).subquery()
        if (session.scalar(select(func.count()).select_from(some)) or 0) > most:
            return {}
    query = select(SolutionRow.id, SolutionRow.x).where(SolutionRow.id.in_(of_campaign))
    return {solution_id: x for solution_id, x in session.execute(query)}


def n_solves(session: Session, campaign_id: int) -> int:
    """Return how many solves a campaign has made, as its searches count them."""
    if session.get(CampaignRow, campaign_id) is None:
        raise UnknownRow("campaign", campaign_id)
    return (
        session.scalar(select(func.sum(SearchRow.n_solves)).where(SearchRow.campaign_id == campaign_id)) or 0
    )
