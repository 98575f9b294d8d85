"""Campaigns in a list, each with how far it is and what it has found: quick however large they are."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
from sqlalchemy import func, literal_column, select
from sqlalchemy.orm import Session

from service.api.history_schemas import CampaignCard, Outcomes
from service.db.tables import CampaignRow, JobRow, SearchRow
from service.scheduler import plan
from service.scheduler.states import ENDED
from service.store.histories import Histories
from service.store.specs import search_spec
from service.store.tally import Step, Tally

#: Moments of a sparkline.
N_MOMENTS = 60


def campaign_cards(session: Session, known: Histories, now: float, limit: int = 200) -> list[CampaignCard]:
    """Return the campaigns, the newest first."""
    campaigns = session.scalars(select(CampaignRow).order_by(CampaignRow.id.desc()).limit(limit)).all()
    ids = [campaign.id for campaign in campaigns]
    searches = defaultdict(list)
    rows = select(SearchRow).where(SearchRow.campaign_id.in_(ids)).order_by(SearchRow.position)
    for row in session.scalars(rows):
        searches[row.campaign_id].append(row)
    n_open = _open_jobs(session)
    return [_card(one, searches[one.id], known.tally(one), n_open, now) for one in campaigns]


def _card(
    campaign: CampaignRow, searches: Sequence[SearchRow], tally: Tally, n_open: dict[int, int], now: float
) -> CampaignCard:
    end = campaign.finished_at or now
    planned = [plan.n_planned(search_spec(campaign, row), row.n_planned) for row in searches]
    rate = tally.rate_per_min(end)
    n_jobs = sum(row.n_planned for row in searches)
    return CampaignCard(
        **_named(campaign),
        n_jobs=n_jobs,
        n_done=n_jobs - sum(n_open.get(row.id, 0) for row in searches),
        n_solves=sum(row.n_solves for row in searches),
        n_solutions=tally.n_solutions,
        best_delta_v_km_s=tally.steps[-1].delta_v_km_s if tally.steps else None,
        outcomes=Outcomes(**tally.outcomes),
        n_guesses_planned=_sum(planned),
        n_searches=len(searches),
        strategies=list(dict.fromkeys(row.strategy for row in searches)),
        rate_per_min=rate,
        eta_seconds=_eta_seconds(campaign, searches, planned, rate),
        elapsed_seconds=end - campaign.created_at,
        cpu_seconds=sum(row.cpu_seconds for row in searches),
        sparkline_km_s=sparkline(tally.steps, campaign.created_at, end),
        n_read=sum(tally.outcomes.values()),
    )


def _named(campaign: CampaignRow) -> dict[str, Any]:
    names = ("id", "name", "state", "priority", "created_at", "finished_at", "rng_seed")
    return {name: getattr(campaign, name) for name in names}


def _open_jobs(session: Session) -> dict[int, int]:
    """Return how many jobs of each search wait or run: each state has an index of its own for that."""
    found: dict[int, int] = defaultdict(int)
    for state in ("queued", "running"):
        is_so = JobRow.state == literal_column(f"'{state}'")
        query = select(JobRow.search_id, func.count()).where(is_so).group_by(JobRow.search_id)
        for search_id, number in session.execute(query):
            found[search_id] += number
    return found


def _sum(planned: Sequence[int | None]) -> int | None:
    known = [number for number in planned if number is not None]
    return sum(known) if len(known) == len(planned) else None


def _eta_seconds(
    campaign: CampaignRow, searches: Sequence[SearchRow], planned: Sequence[int | None], rate_per_min: float
) -> float | None:
    if campaign.state in ENDED:
        return 0.0
    going_on = [(row, n) for row, n in zip(searches, planned, strict=True) if row.state not in ENDED]
    if rate_per_min == 0.0 or campaign.state == "paused" or any(n is None for _, n in going_on):
        return None
    return 60.0 * sum(max(0, (n or 0) - row.n_solves) for row, n in going_on) / rate_per_min


def sparkline(steps: Sequence[Step], begin: float, end: float) -> list[float | None]:
    """Return the best delta-v at moments from begin to end, None before the first solution."""
    if not steps:
        return []
    moments = np.linspace(begin, end, N_MOMENTS)
    places = np.searchsorted([step.at for step in steps], moments, side="right") - 1
    # What was stored in the very moment of the end is known then.
    places[-1] = len(steps) - 1
    return [steps[place].delta_v_km_s if place >= 0 else None for place in places]
