"""One search: how it is set up and how far it is, quickly however many solves it has."""

from typing import Any, cast

from sqlalchemy import func, select, true
from sqlalchemy.orm import Session

from core.search import HopSettings
from service.api.schemas import CampaignState, CaseView, JobCounts, OutageView, SearchState
from service.api.search_schemas import BudgetView, LawsView, SearchDetail, SeedRules
from service.db.counts import counted
from service.db.tables import CampaignRow, CaseRow, JobRow, SearchRow, SolutionRow, SolveRow
from service.scheduler import plan
from service.search_spec import SearchSpec
from service.store.control import get_campaign_row
from service.store.errors import UnknownRow
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
    jobs = select(JobRow.state, func.count()).where(JobRow.search_id == row.id).group_by(JobRow.state)
    counts = counted(session, jobs)
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
        jobs=JobCounts(**counts),
        n_guesses_planned=plan.n_planned(spec, sum(counts.values())),
        n_solves=row.n_solves,
        cpu_seconds=row.cpu_seconds,
        **_verdicts(session, row.id),
        **_best(session, row.id),
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


def _verdicts(session: Session, search_id: int) -> dict[str, Any]:
    """Return how many solves are feasible at each level, counted in the index alone."""
    of_search = SolveRow.search_id == search_id
    query = (
        select(SolveRow.strict, func.count())
        .where(of_search, SolveRow.paper.is_(true()))
        .group_by(SolveRow.strict)
    )
    counts: dict[bool, int] = {bool(strict): n for strict, n in session.execute(query)}
    return {"n_paper": sum(counts.values()), "n_strict": counts.get(True, 0)}


def _best(session: Session, search_id: int) -> dict[str, Any]:
    """Return the strict solution with the most final mass, which stands at the end of the index."""
    query = (
        select(SolveRow.solution_id, SolutionRow.delta_v_km_s)
        .join(SolutionRow, SolutionRow.id == SolveRow.solution_id)
        .where(SolveRow.search_id == search_id, SolveRow.paper.is_(true()), SolveRow.strict.is_(true()))
        .order_by(SolveRow.objective_kg.desc())
        .limit(1)
    )
    found = session.execute(query).first()
    return {"best_solution_id": found and found[0], "best_delta_v_km_s": found and found[1]}
