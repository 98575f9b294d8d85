"""Campaigns and their searches: their numbers, lists of them, and how operators control them.

Lists cost little however large campaigns are.  Pause, resume, cancel and retry are idempotent.
"""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, cast

import numpy as np
from sqlalchemy import ColumnElement, func, literal_column, select, update
from sqlalchemy.orm import Session, aliased, load_only

from service import scheduler
from service.db.tables import CampaignRow, CaseRow, JobRow, SearchRow, SolutionRow, SolveRow
from service.db.transitions import ENDED, sources
from service.schemas.campaign import CampaignCard, CampaignItem, CampaignView, Outcomes
from service.schemas.problem import CaseView, OutageView
from service.schemas.search import JobCounts, SearchState, SearchView
from service.spec.search_spec import SearchSpec
from service.store.cache import search_spec, spec_of
from service.store.campaign_history import History, HistoryCache, Step, ratio_view
from service.store.errors import UnknownRowError, WrongStateError
from service.store.events import note, note_job, note_search
from service.store.planning import advance, enter
from service.store.statistics import job_states, n_solutions, summed, tallies

#: The rate is that of the last minutes, so that it follows the number of workers.
RATE_WINDOW_S = 300.0


def list_campaigns(session: Session, limit: int = 200) -> list[CampaignItem]:
    """Return the campaigns, the newest first."""
    return [
        CampaignItem(**item_fields(row, numbers)) for row, numbers in campaigns_in_numbers(session, limit)
    ]


def campaigns_in_numbers(session: Session, limit: int) -> list[tuple[CampaignRow, "list[Numbers]"]]:
    """Return the campaigns, the newest first, with the numbers of their searches in order."""
    rows = session.scalars(select(CampaignRow).order_by(CampaignRow.id.desc()).limit(limit)).all()
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
    counts = summed(one.jobs for one in numbers)
    found = summed(one.tallies.get("solution", {}) for one in numbers)
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
    window = min(RATE_WINDOW_S, max(end - campaign.created_at, 1.0))
    recent = (SearchRow.campaign_id == campaign.id) & (SolveRow.created_at > end - window)
    n_recent = session.scalar(select(func.count(SolveRow.id)).join(SearchRow).where(recent)) or 0
    return 60.0 * n_recent / window


def eta_seconds(
    campaign: CampaignRow, numbers: Sequence[Numbers], planned: Sequence[int | None], rate_per_min: float
) -> float | None:
    """Return how long a campaign still takes at a rate, from what its searches have planned [s]."""
    if campaign.state in ENDED:
        return 0.0
    going_on = [(one.row, n) for one, n in zip(numbers, planned, strict=True) if one.row.state not in ENDED]
    if rate_per_min == 0.0 or campaign.state == "paused" or any(n is None for _, n in going_on):
        return None
    return 60.0 * sum(max(0, (n or 0) - row.n_solves) for row, n in going_on) / rate_per_min


#: Moments of a sparkline.
N_MOMENTS = 60


def campaign_cards(session: Session, known: HistoryCache, now: float, limit: int = 200) -> list[CampaignCard]:
    """Return the campaigns, the newest first."""
    return [
        _card(campaign, numbers, known.history(campaign), now)
        for campaign, numbers in campaigns_in_numbers(session, limit)
    ]


def _card(campaign: CampaignRow, numbers: Sequence[Numbers], history: History, now: float) -> CampaignCard:
    end = campaign.finished_at or now
    planned = [scheduler.n_planned(search_spec(campaign, one.row), one.row.n_planned) for one in numbers]
    rate = history.rate_per_min(end)
    return CampaignCard(
        **item_fields(campaign, numbers),
        outcomes=_outcomes(numbers),
        n_guesses_planned=_sum(planned),
        n_searches=len(numbers),
        strategies=list(dict.fromkeys(one.row.strategy for one in numbers)),
        rate_per_min=rate,
        eta_seconds=eta_seconds(campaign, numbers, planned, rate),
        elapsed_seconds=end - campaign.created_at,
        cpu_seconds=sum(one.row.cpu_seconds for one in numbers),
        sparkline_km_s=sparkline(history.steps, campaign.created_at, end),
        n_read=history.n_solves,
    )


def _outcomes(numbers: Sequence[Numbers]) -> Outcomes:
    """Return how solves ended, from what is counted as they are stored."""
    levels = summed(one.tallies.get("level", {}) for one in numbers)
    endings = summed(one.tallies.get("solve", {}) for one in numbers)
    n_strict, n_paper = levels.get("strict", 0), levels.get("paper", 0)
    odd = {name: endings.get(name, 0) for name in ("timeout", "numerical")}
    n_rest = sum(endings.values()) - n_paper - sum(odd.values())
    return Outcomes(strict=n_strict, paper=n_paper - n_strict, infeasible=n_rest, **odd)


def _sum(planned: Sequence[int | None]) -> int | None:
    known = [number for number in planned if number is not None]
    return sum(known) if len(known) == len(planned) else None


def sparkline(steps: Sequence[Step], begin: float, end: float) -> list[float | None]:
    """Return the best delta-v at moments from begin to end, None before the first solution."""
    if not steps:
        return []
    moments = np.linspace(begin, end, N_MOMENTS)
    places = np.searchsorted([step.at for step in steps], moments, side="right") - 1
    # What was stored in the very moment of the end is known then.
    places[-1] = len(steps) - 1
    return [steps[place].delta_v_km_s if place >= 0 else None for place in places]


Verb = Literal["pause", "resume", "cancel"]
STATE_AFTER = {"pause": "paused", "resume": "active", "cancel": "cancelled"}


def control_campaign(session: Session, campaign_id: int, verb: Verb, now: float) -> None:
    """Pause a campaign, let it go on, or cancel it."""
    campaign = get_campaign_row(session, campaign_id)
    state = STATE_AFTER[verb]
    if campaign.state == state:
        return
    _require("campaign", campaign_id, campaign.state, verb)
    campaign.state = state
    if verb == "cancel":
        campaign.finished_at = now
        for row in session.scalars(select(SearchRow).where(SearchRow.campaign_id == campaign_id)):
            if row.state not in ENDED:
                _cancel_search(session, row, now)
    note(session, campaign_id, "campaign", now, state=state)
    advance(session, campaign, now)


def control_search(session: Session, campaign_id: int, name: str, verb: Verb, now: float) -> None:
    """Pause a search, let it go on, or cancel it; searches that it feeds go on with what there is."""
    campaign, row = get_search_row(session, campaign_id, name)
    is_so = row.state in ("waiting", "active") if verb == "resume" else row.state == STATE_AFTER[verb]
    if is_so:
        return
    _require("search", name, row.state, verb)
    if verb == "cancel":
        _cancel_search(session, row, now)
    elif verb == "pause":
        enter(session, campaign, row, "paused", now)
    else:
        # Seeds that are chosen once were chosen if there are jobs.
        enter(session, campaign, row, "active" if row.n_planned else "waiting", now)
    advance(session, campaign, now)


def _cancel_search(session: Session, row: SearchRow, now: float) -> None:
    """Take its jobs out of the queue, and have those that run stopped."""
    own = JobRow.search_id == row.id
    queued, running = own & (JobRow.state == "queued"), own & (JobRow.state == "running")
    session.execute(update(JobRow).where(queued).values(state="cancelled", updated_at=now))
    session.execute(update(JobRow).where(running).values(is_cancelling=True, updated_at=now))
    row.state = "cancelled"
    note_search(session, row, now)


def set_campaign(session: Session, campaign_id: int, priority: int) -> None:
    """Let a campaign go before others, or after them."""
    get_campaign_row(session, campaign_id).priority = priority


def set_search(
    session: Session, campaign_id: int, name: str, weight: float | None, priority: int | None
) -> None:
    """Give a search another part of the workers, or another place before or after other searches."""
    _, row = get_search_row(session, campaign_id, name)
    row.weight = row.weight if weight is None else weight
    row.priority = row.priority if priority is None else priority


def cancel_job(session: Session, job_id: int, now: float) -> None:
    """Take a job out of the queue, or have it stopped; what it still reports through the fence is kept."""
    job, search, campaign = _job(session, job_id)
    if job.state == "cancelled" or job.is_cancelling:
        return
    _require("job", job_id, job.state, "cancel")
    if job.state == "running":
        job.is_cancelling, job.updated_at = True, now
        return
    job.state, job.updated_at = "cancelled", now
    note_job(session, search, job, now)
    advance(session, campaign, now)


def requeue_job(session: Session, job_id: int, now: float) -> None:
    """Give a dead or cancelled job another attempt, with a clean record."""
    job, search, campaign = _job(session, job_id)
    if job.state == "queued":
        return
    _require("job", job_id, job.state, "requeue")
    # A cancelled campaign has cancelled searches alone.
    if search.state == "cancelled":
        raise WrongStateError(
            f"search {search.name}: expected a search that goes on, got one that is cancelled"
        )
    _requeue(session, [job], now)
    _open_again(session, campaign, {search.id}, now)
    session.flush()
    if job.state != "queued":
        raise WrongStateError(f"search {search.name}: expected a budget that is not used up, got one that is")
    note_job(session, search, job, now)


def revive(session: Session, campaign_id: int, now: float) -> int:
    """Put back the jobs of a campaign that were given up, with a clean record; return how many."""
    campaign = get_campaign_row(session, campaign_id)
    if campaign.state == "cancelled":
        return 0
    open_searches = select(SearchRow.id).where(
        SearchRow.campaign_id == campaign_id, SearchRow.state != "cancelled"
    )
    # Its state stands as text, since only then is the index of that state used.
    dead = (JobRow.search_id.in_(open_searches)) & (JobRow.state == literal_column("'dead'"))
    jobs = list(session.scalars(select(JobRow).where(dead)))
    if jobs:
        _requeue(session, jobs, now)
        _open_again(session, campaign, {job.search_id for job in jobs}, now)
        note(session, campaign_id, "campaign", now, state=campaign.state, n_requeued=len(jobs))
    return len(jobs)


def _requeue(session: Session, jobs: list[JobRow], now: float) -> None:
    for job in jobs:
        job.state, job.n_failures, job.not_before, job.updated_at = "queued", 0, 0.0, now
    session.flush()


def _open_again(session: Session, campaign: CampaignRow, search_ids: set[int], now: float) -> None:
    """Open the searches of jobs that run again, and those that they feed, which may get new seeds now."""
    rows = session.scalars(select(SearchRow).where(SearchRow.campaign_id == campaign.id))
    reopened = set(search_ids)
    # A source comes before what it feeds.
    for row in sorted(rows, key=lambda row: row.id):
        if row.state == "done" and (row.id in reopened or row.source_id in reopened):
            enter(session, campaign, row, "active" if row.id in search_ids else "waiting", now)
            reopened.add(row.id)
    if campaign.state == "done":
        campaign.state, campaign.finished_at = "active", None
        note(session, campaign.id, "campaign", now, state="active")
    advance(session, campaign, now)


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


def _job(session: Session, job_id: int) -> tuple[JobRow, SearchRow, CampaignRow]:
    job = session.get(JobRow, job_id)
    if job is None:
        raise UnknownRowError("job", job_id)
    search = session.get_one(SearchRow, job.search_id)
    return job, search, session.get_one(CampaignRow, search.campaign_id)


def _require(noun: str, name: object, state: str, verb: str) -> None:
    """Raise unless a verb can be said in a state; the changes that it makes are among those that exist."""
    if verb in ("resume", "requeue"):
        wanted = ["paused"] if verb == "resume" else ["dead", "cancelled"]
    else:
        wanted = sources(noun, STATE_AFTER[verb])
    if state not in wanted:
        raise WrongStateError(f"{noun} {name}: expected state {' or '.join(wanted)} to {verb}, got {state}")
