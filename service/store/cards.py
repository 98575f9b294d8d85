"""Campaigns in a list, each with how far it is and what it has found: quick however large they are."""

from collections.abc import Sequence

import numpy as np
from sqlalchemy.orm import Session

from service.db.tables import CampaignRow
from service.scheduler import plan
from service.schemas.campaign import CampaignCard, Outcomes
from service.store.chronicle import Chronicle, Step
from service.store.chronicles import Chronicles
from service.store.progress import Numbers, campaigns_in_numbers, eta_seconds, item_fields
from service.store.specs import search_spec
from service.store.tallies import summed

#: Moments of a sparkline.
N_MOMENTS = 60


def campaign_cards(session: Session, known: Chronicles, now: float, limit: int = 200) -> list[CampaignCard]:
    """Return the campaigns, the newest first."""
    return [
        _card(campaign, numbers, known.chronicle(campaign), now)
        for campaign, numbers in campaigns_in_numbers(session, limit)
    ]


def _card(
    campaign: CampaignRow, numbers: Sequence[Numbers], chronicle: Chronicle, now: float
) -> CampaignCard:
    end = campaign.finished_at or now
    planned = [plan.n_planned(search_spec(campaign, one.row), one.row.n_planned) for one in numbers]
    rate = chronicle.rate_per_min(end)
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
        sparkline_km_s=sparkline(chronicle.steps, campaign.created_at, end),
        n_read=chronicle.n_solves,
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
