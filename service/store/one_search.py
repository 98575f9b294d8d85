"""One search: how it is set up and how far it is, quickly however many solves it has."""

from typing import cast

from sqlalchemy.orm import Session

from core.search import HopSettings
from service.db.tables import SearchRow
from service.scheduler import plan
from service.schemas.answer import CampaignState
from service.schemas.search import BudgetView, JobCounts, LawsView, SearchDetail, SearchState, SeedRules
from service.spec.search_spec import SearchSpec
from service.store.control import get_search_row
from service.store.progress import cases_of, numbers_of
from service.store.specs import search_spec


def get_search(session: Session, campaign_id: int, name: str) -> SearchDetail:
    """Return a search of a campaign."""
    campaign, row = get_search_row(session, campaign_id, name)
    spec = search_spec(campaign, row)
    (numbers,) = numbers_of(session, SearchRow.id == row.id)
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
        cases=cases_of(session, row, spec),
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
