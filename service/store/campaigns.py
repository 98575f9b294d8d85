"""Lists of campaigns and searches from counters, fast for large campaigns."""

from collections.abc import Sequence
from typing import Any, NamedTuple, cast

from sqlalchemy import ColumnElement, func, select
from sqlalchemy.orm import Session, aliased, load_only

from core.analysis.metrics import feasibility_ratio
from service import scheduler
from service.db.tables import CampaignRow, CaseRow, SearchRow, SolutionRow, SolveRow
from service.db.transitions import ENDED
from service.schemas.campaign import CampaignItem, CampaignView
from service.schemas.problem import CaseView, OutageView
from service.schemas.search import JobCounts, RatioView, SearchState, SearchView
from service.spec.search_spec import SearchSpec
from service.store.cache import search_spec, spec_of
from service.store.errors import UnknownRowError
from service.store.statistics import job_states, n_solutions, sum_counts, tallies


def ratio_view(n: int, n_solves: int) -> RatioView:
    """Return a share of solves with its interval; its value is None while there are no solves."""
    ratio = feasibility_ratio(n, n_solves)
    return RatioView(value=ratio.value if n_solves else None, low=ratio.low, high=ratio.high)


#: The rate is that of the last minutes, so that it follows the number of workers, counted in slots [s].
RATE_WINDOW_S, SLOT_S = 300.0, 5.0


#: Campaigns that are listed, the newest.
MOST_CAMPAIGNS = 200


def list_campaigns(session: Session) -> list[CampaignItem]:
    """Return the campaigns, the newest first."""
    return [CampaignItem(**item_fields(row, numbers)) for row, numbers in campaigns_in_numbers(session)]


def campaigns_in_numbers(
    session: Session, only: int | None = None
) -> list[tuple[CampaignRow, "list[Numbers]"]]:
    """Return the campaigns, the newest first, or one, with the numbers of their searches in order."""
    query = select(CampaignRow).order_by(CampaignRow.id.desc()).limit(MOST_CAMPAIGNS)
    rows = session.scalars(query if only is None else query.where(CampaignRow.id == only)).all()
    of_campaign: dict[int, list[Numbers]] = {row.id: [] for row in rows}
    for one in numbers_of(session, SearchRow.campaign_id.in_(of_campaign)):
        of_campaign[one.row.campaign_id].append(one)
    return [(row, of_campaign[row.id]) for row in rows]


def get_campaign(session: Session, campaign_id: int, now: float) -> CampaignView:
    """Return a campaign with its searches."""
    campaign = session.get(CampaignRow, campaign_id)
    if campaign is None:
        raise UnknownRowError("campaign", campaign_id)
    numbers = numbers_of(session, SearchRow.campaign_id == campaign_id)
    searches = [_search(session, campaign, one) for one in numbers]
    rate = _rate_per_min(session, campaign, now)
    planned = [search.n_guesses_planned for search in searches]
    return CampaignView(
        **item_fields(campaign, numbers),
        problem=spec_of(campaign).problem.model_dump(mode="json"),
        searches=searches,
        rate_per_min=rate,
        eta_seconds=eta_seconds(campaign, numbers, planned, rate),
        # A clock that was set back has nothing to tell.
        elapsed_seconds=max(0.0, (campaign.finished_at or now) - campaign.created_at),
        cpu_seconds=sum(search.cpu_seconds for search in searches),
    )


class Numbers(NamedTuple):
    """What is known of a search without looking at its jobs and solves one by one."""

    row: SearchRow
    #: By state, and by noun and name.
    jobs: dict[str, int]
    tallies: dict[str, dict[str, int]]
    #: The strict solution with the most final mass.
    best: SolutionRow | None


def numbers_of(session: Session, wanted: ColumnElement[bool]) -> list[Numbers]:
    """Return the numbers of some searches, in order of campaign and position."""
    jobs, counted, best = job_states(session, wanted), tallies(session, wanted), _best(session, wanted)
    rows = session.scalars(
        select(SearchRow).where(wanted).order_by(SearchRow.campaign_id, SearchRow.position)
    )
    return [Numbers(row, jobs[row.id], counted.get(row.id, {}), best.get(row.id)) for row in rows]


def _best(session: Session, wanted: ColumnElement[bool]) -> dict[int, SolutionRow]:
    """Return the strict solution with the most final mass of each search that has one."""
    again = aliased(SolveRow)
    first = (
        select(again.id)
        .where(again.search_id == SearchRow.id, again.solution_id.is_not(None), again.strict)
        .order_by(again.final_mass_kg.desc(), again.solution_id)
        .limit(1)
        .correlate(SearchRow)
        .scalar_subquery()
    )
    query = (
        select(SearchRow.id, SolutionRow)
        .select_from(SearchRow)
        .join(SolveRow, SolveRow.id == first)
        .join(SolutionRow, SolutionRow.id == SolveRow.solution_id)
        .where(wanted)
        .options(load_only(SolutionRow.objective_kg, SolutionRow.delta_v_km_s, SolutionRow.propellant_kg))
    )
    return {search_id: solution for search_id, solution in session.execute(query)}


def item_fields(campaign: CampaignRow, numbers: Sequence[Numbers]) -> dict[str, Any]:
    """Return what lists show of a campaign, in the names of `CampaignItem`."""
    counts = sum_counts(one.jobs for one in numbers)
    found = sum_counts(one.tallies.get("solution", {}) for one in numbers)
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
        "n_solves": sum(one.row.n_solves for one in numbers),
        "n_solutions": n_solutions(found, "campaign"),
        "best_delta_v_km_s": min((one.best.delta_v_km_s for one in numbers if one.best), default=None),
    }


def _search(session: Session, campaign: CampaignRow, numbers: Numbers) -> SearchView:
    row, counted, best = numbers.row, numbers.tallies, numbers.best
    spec = search_spec(campaign, row)
    levels = counted.get("level", {})
    return SearchView(
        id=row.id,
        name=row.name,
        strategy=row.strategy,
        state=cast(SearchState, row.state),
        priority=row.priority,
        weight=row.weight,
        k=spec.k,
        cases=cases_of(session, row, spec),
        mapping=", ".join(spec.mapping) if spec.seeds else None,
        seeds_from=spec.seeds.full_name if spec.seeds else None,
        jobs=JobCounts(**numbers.jobs),
        hops=spec.hops,
        n_guesses_planned=scheduler.n_planned(spec, row.n_planned),
        endings=counted.get("solve", {}),
        statuses=counted.get("status", {}),
        n_solves=row.n_solves,
        n_paper=levels.get("paper", 0),
        n_strict=levels.get("strict", 0),
        strict_ratio=ratio_view(levels.get("strict", 0), row.n_solves),
        n_solutions=n_solutions(counted.get("solution", {}), "search"),
        cpu_seconds=row.cpu_seconds,
        best_solution_id=best.id if best else None,
        best_delta_v_km_s=best.delta_v_km_s if best else None,
        best_propellant_kg=best.propellant_kg if best else None,
        best_final_mass_kg=best.objective_kg if best else None,
    )


def cases_of(session: Session, row: SearchRow, spec: SearchSpec) -> list[CaseView]:
    """Return the problems that a search is about."""
    query = select(CaseRow.problem_hash).where(CaseRow.search_id == row.id).order_by(CaseRow.position)
    return [
        CaseView(problem_hash=problem_hash, outages=[OutageView(segment=n, duration_days=d) for n, d in case])
        for problem_hash, case in zip(session.scalars(query), spec.outage_sets, strict=True)
    ]


def _rate_per_min(session: Session, campaign: CampaignRow, now: float) -> float:
    end = campaign.finished_at or now
    recent = (SearchRow.campaign_id == campaign.id) & (SolveRow.created_at >= first_slot(end) * SLOT_S)
    n_recent = session.scalar(select(func.count(SolveRow.id)).join(SearchRow).where(recent)) or 0
    return rate_per_min(n_recent, campaign.created_at, end)


def first_slot(end: float) -> int:
    """Return the slot in which the last minutes before a moment begin."""
    return int((end - RATE_WINDOW_S) // SLOT_S)


def rate_per_min(n_recent: int, created_at: float, end: float) -> float:
    """Return how many solves a minute there were, from those since the first slot or the start."""
    began = max(created_at, first_slot(end) * SLOT_S)
    return 60.0 * n_recent / max(end - began, 1.0)


def eta_seconds(
    campaign: CampaignRow, numbers: Sequence[Numbers], planned: Sequence[int | None], rate: float
) -> float | None:
    """Return how long a campaign still takes at a rate, from what its searches have planned [s]."""
    if campaign.state in ENDED:
        return 0.0
    going_on = [(one.row, n) for one, n in zip(numbers, planned, strict=True) if one.row.state not in ENDED]
    if rate == 0.0 or campaign.state == "paused" or any(n is None for _, n in going_on):
        return None
    return 60.0 * sum(max(0, (n or 0) - row.n_solves) for row, n in going_on) / rate


def get_campaign_row(session: Session, campaign_id: int) -> CampaignRow:
    """Return the row of a campaign."""
    campaign = session.get(CampaignRow, campaign_id)
    if campaign is None:
        raise UnknownRowError("campaign", campaign_id)
    return campaign


def get_search_row(session: Session, campaign_id: int, name: str) -> tuple[CampaignRow, SearchRow]:
    """Return the rows of a campaign and of its search of a name."""
    campaign = get_campaign_row(session, campaign_id)
    own = (SearchRow.campaign_id == campaign_id) & (SearchRow.name == name)
    row = session.scalar(select(SearchRow).where(own))
    if row is None:
        raise UnknownRowError("search", f"{name} of campaign {campaign_id}", "none of this name")
    return campaign, row
