"""One search: how it is set up and how far it is, quickly however many solves it has."""

from typing import cast

from sqlalchemy import select
from sqlalchemy.orm import Session

from core.search import HopSettings
from service.api.schemas import CampaignState, CaseView, JobCounts, OutageView, SearchState
from service.api.search_schemas import BudgetView, LawsView, SearchDetail, SeedRules
from service.db.tables import CampaignRow, CaseRow, SearchRow
from service.scheduler import plan
from service.search_spec import SearchSpec
from service.store.control import get_campaign_row
from service.store.errors import UnknownRow
from service.store.progress import numbers_of
from service.store.specs import search_spec


def find_search(session: Session, campaign_id: int, name: str) -> tuple[CampaignRow, SearchRow]:
    """Return a campaign and its search of a name."""
    campaign = get_campaign_row(session, campaign_id)
    own = (SearchRow.campaign_id == campaign_id) & (SearchRow.name == name)
    row = session.scalar(select(SearchRow).where(own))
    if row is None:
        raise UnknownRow("search", f"{name} of campaign {campaign_id}")
    return campaign, row


def get_search(session: Session, campaign_id: int, name: str) -> SearchDetail:
    """Return a search of a campaign."""
    campaign, row = find_search(session, campaign_id, name)
    spec = search_spec(campaign, row)
    numbers = numbers_of(session, SearchRow.id == row.id)[row.id]
    levels, best = numbers.tallies.get("level", {}), numbers.best
    return SearchDetail(
        campaign_id=campaign.id,
        campaign=campaign.name,
        campaign_state=cast(CampaignState, campaign.state),
        id=row.id,
        name=row.name,
        strategy=row.strategy,
        state=cast(SearchState, row.state),
        priority=row.priority,
        weight=row.weight,
        k=spec.k,
        seed_k=spec.seed_k,
        cases=_cases(session, row, spec),
        hops=spec.hops,
        budget=BudgetView(guesses=spec.guesses, core_seconds=spec.core_seconds, solutions=spec.solutions),
        laws=None if spec.seeds else _laws(spec),
        seeds=_seed_rules(spec),
        solve_cpu_seconds=spec.cpu_seconds,
        max_iterations=spec.max_iterations,
        jobs=JobCounts(**numbers.jobs),
        n_guesses_planned=plan.n_planned(spec, row.n_planned),
        n_solves=row.n_solves,
        cpu_seconds=row.cpu_seconds,
        n_paper=levels.get("paper", 0),
        n_strict=levels.get("strict", 0),
        best_solution_id=best.id if best else None,
        best_delta_v_km_s=best.delta_v_km_s if best else None,
    )


def _cases(session: Session, row: SearchRow, spec: SearchSpec) -> list[CaseView]:
    query = select(CaseRow.problem_hash).where(CaseRow.search_id == row.id).order_by(CaseRow.position)
    return [
        CaseView(problem_hash=problem_hash, outages=[OutageView(segment=n, duration_days=d) for n, d in case])
        for problem_hash, case in zip(session.scalars(query), spec.outage_sets, strict=True)
    ]


def _laws(spec: SearchSpec) -> LawsView:
    laws = HopSettings(**spec.laws.model_dump())
    return LawsView(
        guess_law=laws.guess_law,
        hop_law=laws.hop_law,
        width=laws.width,
        shape=laws.shape,
        adaptive=laws.adaptive,
        width_range=laws.width_range if laws.adaptive else None,
        time_hop_probability=laws.time_hop_probability,
        max_failures=laws.max_failures,
    )


def _seed_rules(spec: SearchSpec) -> SeedRules | None:
    if spec.seeds is None:
        return None
    return SeedRules(**spec.seeds.model_dump(), mapping=list(spec.mapping))
