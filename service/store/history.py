"""How a campaign came to what it has found: improvements, outcomes over time, seeds, delta-v."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from core.analysis.metrics import feasibility_ratio
from service.db.tables import CampaignRow, SearchRow
from service.schemas.campaign import (
    BoxView,
    ChainView,
    HistoryView,
    OutcomeBinsView,
    RatioView,
    StepView,
    StrategyView,
)
from service.store.chronicle import Chronicle, Step, StrategyChronicle
from service.store.chronicles import Chronicles
from service.store.errors import UnknownRow

#: Steps of one strategy, delta-v of one box and of all boxes that are sent at most.
MOST_STEPS, MOST_OF_BOX, MOST_OF_BOXES = 200, 120, 3000
SECONDS_PER_HOUR = 3600.0


def campaign_history(session: Session, chronicles: Chronicles, campaign_id: int) -> HistoryView:
    """Return the history of a campaign."""
    campaign = session.get(CampaignRow, campaign_id)
    if campaign is None:
        raise UnknownRow("campaign", campaign_id)
    chronicle = chronicles.chronicle(campaign)
    n_solves = select(func.sum(SearchRow.n_solves)).where(SearchRow.campaign_id == campaign_id)
    strategies = sorted(chronicle.strategies.items(), key=lambda item: _place(item[1]))
    return HistoryView(
        campaign_id=campaign_id,
        n_solves=session.scalar(n_solves) or 0,
        n_read=chronicle.n_solves,
        outcomes=OutcomeBinsView(width_seconds=chronicle.bins.width_s, **chronicle.bins.lists()),
        strategies=[_strategy(name, one) for name, one in strategies],
        chains=_chains(chronicle),
        delta_v=_boxes(chronicle),
    )


def _place(one: StrategyChronicle) -> tuple[int, int]:
    return one.k, -1 if one.seed_k is None else one.seed_k


def _ratio(n: int, n_solves: int) -> RatioView:
    ratio = feasibility_ratio(n, n_solves)
    return RatioView(value=ratio.value if n_solves else None, low=ratio.low, high=ratio.high)


def _strategy(name: str, one: StrategyChronicle) -> StrategyView:
    n_solves, n_strict = int(one.outcomes.sum()), int(one.outcomes[0])
    n_paper = n_strict + int(one.outcomes[1])
    return StrategyView(
        strategy=name,
        k=one.k,
        seed_k=one.seed_k,
        n_solves=n_solves,
        n_paper=n_paper,
        n_strict=n_strict,
        paper_ratio=_ratio(n_paper, n_solves),
        strict_ratio=_ratio(n_strict, n_solves),
        core_hours=one.cpu_seconds / SECONDS_PER_HOUR,
        steps=[
            StepView(core_hours=at / SECONDS_PER_HOUR, delta_v_km_s=delta_v, solution_id=solution_id)
            for at, delta_v, solution_id in _evenly(one.steps, MOST_STEPS)
        ],
    )


def _evenly(steps: Sequence[Step], most: int) -> list[Step]:
    return [steps[place] for place in _places(len(steps), most)]


def _places(n: int, most: int) -> list[int]:
    """Return all places of a list, or so many evenly, the first and the last among them."""
    if n <= most:
        return list(range(n))
    places: list[int] = np.linspace(0, n - 1, most).round().astype(int).tolist()
    return places


def _chains(chronicle: Chronicle) -> list[ChainView]:
    groups: defaultdict[tuple[int | None, int], list[StrategyChronicle]] = defaultdict(list)
    for one in chronicle.strategies.values():
        groups[one.seed_k, one.k].append(one)
    order = sorted(groups, key=lambda pair: (-1 if pair[0] is None else pair[0], pair[1]))
    return [_chain(chronicle, seed_k, k, groups[seed_k, k]) for seed_k, k in order]


def _chain(chronicle: Chronicle, seed_k: int | None, k: int, group: Sequence[StrategyChronicle]) -> ChainView:
    n_solves = sum(int(one.outcomes.sum()) for one in group)
    n_strict = sum(int(one.outcomes[0]) for one in group)
    seconds = sum(one.cpu_seconds for one in group)
    return ChainView(
        seed_k=seed_k,
        k=k,
        n_seeds=0 if seed_k is None else len(chronicle.seeds[seed_k, k]),
        n_solves=n_solves,
        n_strict=n_strict,
        strict_ratio=_ratio(n_strict, n_solves),
        core_seconds_per_strict=seconds / n_strict if n_strict else None,
    )


def _boxes(chronicle: Chronicle) -> list[BoxView]:
    most = min(MOST_OF_BOX, MOST_OF_BOXES // max(1, len(chronicle.delta_v)))
    groups = [
        (chronicle.strategies[name], name, days, values) for (name, days), values in chronicle.delta_v.items()
    ]
    groups.sort(key=lambda group: (_place(group[0]), group[2] is None, group[2] or 0.0))
    return [_box(one.k, name, days, np.sort(values), most) for one, name, days, values in groups]


def _box(k: int, strategy: str, duration_days: float | None, ordered: Any, most: int) -> BoxView:
    least, lower, median, upper, greatest = np.quantile(ordered, (0.0, 0.25, 0.5, 0.75, 1.0)).tolist()
    return BoxView(
        strategy=strategy,
        k=k,
        duration_days=duration_days,
        n_solutions=len(ordered),
        least_km_s=least,
        lower_quartile_km_s=lower,
        median_km_s=median,
        upper_quartile_km_s=upper,
        greatest_km_s=greatest,
        sample_km_s=[ordered[place] for place in _places(len(ordered), most)],
    )
