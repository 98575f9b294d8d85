"""Campaigns and their searches in numbers."""

from typing import Any, cast

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.api.schemas import (
    CampaignItem,
    CampaignView,
    CaseView,
    JobCounts,
    OutageView,
    SearchState,
    SearchView,
)
from service.db.counts import counted
from service.db.tables import CampaignRow, CaseRow, JobRow, SearchRow, SolutionRow, SolveRow
from service.scheduler import plan
from service.search_spec import SearchSpec
from service.store.errors import UnknownRow
from service.store.specs import search_spec, spec_of

#: The rate is that of the last minutes, so that it follows the number of workers.
RATE_WINDOW_S = 300.0


def list_campaigns(session: Session, limit: int = 200) -> list[CampaignItem]:
    """Return the campaigns, the newest first."""
    rows = session.scalars(select(CampaignRow).order_by(CampaignRow.id.desc()).limit(limit)).all()
    return [CampaignItem(**_item(session, row)) for row in rows]


def get_campaign(session: Session, campaign_id: int, now: float) -> CampaignView:
    """Return a campaign with its searches."""
    campaign = session.get(CampaignRow, campaign_id)
    if campaign is None:
        raise UnknownRow("campaign", campaign_id)
    rows = session.scalars(
        select(SearchRow).where(SearchRow.campaign_id == campaign_id).order_by(SearchRow.position)
    )
    searches = [_search(session, campaign, row) for row in rows]
    rate = _rate_per_min(session, campaign, now)
    return CampaignView(
        **_item(session, campaign),
        problem=spec_of(campaign).problem.model_dump(mode="json"),
        searches=searches,
        rate_per_min=rate,
        eta_seconds=_eta_seconds(searches, rate, campaign.state),
        elapsed_seconds=(campaign.finished_at or now) - campaign.created_at,
        cpu_seconds=sum(search.cpu_seconds for search in searches),
    )


def _item(session: Session, campaign: CampaignRow) -> dict[str, Any]:
    in_campaign = SearchRow.campaign_id == campaign.id
    jobs = select(JobRow.state, func.count()).join(SearchRow).where(in_campaign).group_by(JobRow.state)
    counts = counted(session, jobs)
    solves = select(func.count(SolveRow.id), func.count(SolveRow.solution_id.distinct())).join(SearchRow)
    n_solves, n_solutions = session.execute(solves.where(in_campaign)).one()
    best = (
        select(func.min(SolutionRow.delta_v_km_s))
        .join(SolveRow, SolveRow.solution_id == SolutionRow.id)
        .join(SearchRow, SearchRow.id == SolveRow.search_id)
        .where(in_campaign, SolutionRow.strict)
    )
    return {
        "id": campaign.id,
        "name": campaign.name,
        "state": campaign.state,
        "priority": campaign.priority,
        "created_at": campaign.created_at,
        "finished_at": campaign.finished_at,
        "rng_seed": campaign.rng_seed,
        "n_jobs": sum(counts.values()),
        "n_done": sum(counts.get(state, 0) for state in ("done", "dead", "cancelled")),
        "n_solves": n_solves,
        "n_solutions": n_solutions,
        "best_delta_v_km_s": session.scalar(best),
    }


def _search(session: Session, campaign: CampaignRow, row: SearchRow) -> SearchView:
    spec = search_spec(campaign, row)
    jobs = select(JobRow.state, func.count()).where(JobRow.search_id == row.id).group_by(JobRow.state)
    counts = counted(session, jobs)
    of_search = SolveRow.search_id == row.id
    endings = select(SolveRow.ending, func.count()).where(of_search).group_by(SolveRow.ending)
    statuses = select(SolveRow.status, func.count()).where(of_search).group_by(SolveRow.status)
    return SearchView(
        id=row.id,
        name=row.name,
        strategy=row.strategy,
        state=cast(SearchState, row.state),
        priority=row.priority,
        weight=row.weight,
        k=spec.k,
        cases=_cases(session, row, spec),
        mapping=", ".join(spec.mapping) if spec.seeds else None,
        seeds_from=spec.seeds.full_name if spec.seeds else None,
        jobs=JobCounts(**counts),
        hops=spec.hops,
        n_guesses_planned=plan.n_planned(spec, sum(counts.values())),
        endings=counted(session, endings),
        statuses=counted(session, statuses),
        **_totals(session, row.id),
        **_best(session, row.id),
    )


def _cases(session: Session, row: SearchRow, spec: SearchSpec) -> list[CaseView]:
    query = select(CaseRow.problem_hash).where(CaseRow.search_id == row.id).order_by(CaseRow.position)
    return [
        CaseView(problem_hash=problem_hash, outages=[OutageView(segment=n, duration_days=d) for n, d in case])
        for problem_hash, case in zip(session.scalars(query), spec.outage_sets, strict=True)
    ]


def _totals(session: Session, search_id: int) -> dict[str, Any]:
    query = select(
        func.count(SolveRow.id).label("n_solves"),
        func.count(SolveRow.id).filter(SolveRow.paper).label("n_paper"),
        func.count(SolveRow.id).filter(SolveRow.strict).label("n_strict"),
        func.count(SolveRow.solution_id.distinct()).label("n_solutions"),
        func.coalesce(func.sum(SolveRow.cpu_seconds), 0.0).label("cpu_seconds"),
    ).where(SolveRow.search_id == search_id)
    return dict(session.execute(query).one()._mapping)


def _best(session: Session, search_id: int) -> dict[str, Any]:
    """Return the strict solution with the most final mass, in the names of a search's view."""
    query = (
        select(SolutionRow)
        .join(SolveRow, SolveRow.solution_id == SolutionRow.id)
        .where(SolveRow.search_id == search_id, SolutionRow.strict)
        .order_by(SolutionRow.objective_kg.desc(), SolutionRow.id)
        .limit(1)
    )
    best = session.scalar(query)
    return {
        "best_solution_id": best and best.id,
        "best_delta_v_km_s": best and best.delta_v_km_s,
        "best_propellant_kg": best and best.propellant_kg,
        "best_final_mass_kg": best and best.objective_kg,
    }


def _rate_per_min(session: Session, campaign: CampaignRow, now: float) -> float:
    end = campaign.finished_at or now
    window = min(RATE_WINDOW_S, max(end - campaign.created_at, 1.0))
    recent = (SearchRow.campaign_id == campaign.id) & (SolveRow.created_at > end - window)
    n_recent = session.scalar(select(func.count(SolveRow.id)).join(SearchRow).where(recent)) or 0
    return 60.0 * n_recent / window


def _eta_seconds(searches: list[SearchView], rate_per_min: float, state: str) -> float | None:
    if state == "done":
        return 0.0
    planned = [search.n_guesses_planned for search in searches]
    if rate_per_min == 0.0 or None in planned:
        return None
    left = sum(max(0, (s.n_guesses_planned or 0) - s.n_solves) for s in searches if s.state != "done")
    return 60.0 * left / rate_per_min
