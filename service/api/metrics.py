"""Statistics of the strategies of a campaign, from the archive alone.

A table of 100,000 solves takes a second of processor time, so it is made once for all who ask, and of a
campaign that goes on again only when ten times as long has passed.
"""

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from fastapi import APIRouter, Request

from core.analysis.campaign_statistics import findings_of, row, seed_yields, summaries
from core.analysis.comparison import paired_changes
from core.analysis.cumulative_cost import seed_chains
from service.api.context import Id, StoreHere
from service.schemas.search import MetricsRow, MetricsView
from service.store.store import Store

router = APIRouter(tags=["campaigns"])

#: Solutions of a campaign among which the distinct ones are counted; of more it takes seconds, which are left
#: to its report.
MOST_COMPARED = 2000
#: Tables that are remembered; how many times longer than it took to make one it may be shown, and what takes
#: less than this is made anew whenever there is a new solve [s].
REMEMBERED, SHARE, QUICK_S = 20, 10.0, 0.1


class _Made(NamedTuple):
    view: MetricsView
    n_solves: int
    at: float
    took_s: float


class Tables:
    """The latest tables of campaigns, each made by one request at a time."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._made: OrderedDict[int, _Made] = OrderedDict()

    def ask(self, campaign_id: int, n_solves: int, make: Callable[[], MetricsView]) -> MetricsView:
        """Return the table of a campaign with so many solves, made now unless there is one that may serve."""
        with self._lock:
            begin = self._clock()
            made = self._made.get(campaign_id)
            if made is None or not self._serves(made, n_solves, begin):
                view = make()
                end = self._clock()
                self._made[campaign_id] = made = _Made(view, n_solves, end, end - begin)
                self._made.move_to_end(campaign_id)
                if len(self._made) > REMEMBERED:
                    self._made.popitem(last=False)
            return made.view

    def _serves(self, made: _Made, n_solves: int, now: float) -> bool:
        if made.n_solves == n_solves:
            return True
        return made.took_s > QUICK_S and now - made.at < SHARE * made.took_s


@router.get("/campaigns/{campaign_id}/metrics")
def get_metrics(campaign_id: Id, store: StoreHere, request: Request) -> MetricsView:
    """Return ratios, costs, delta-v and seed chains of a campaign, finished or not, with 95 % intervals.

    Of a large campaign that goes on it is some seconds old, and distinct solutions are not counted (null)
    where there are more than 2,000; `coastarc report` counts them.
    """
    tables: Tables = request.app.state.tables
    return tables.ask(campaign_id, store.n_solves(campaign_id), lambda: _metrics(campaign_id, store))


def _metrics(campaign_id: int, store: Store) -> MetricsView:
    facts = store.campaign_facts(campaign_id, MOST_COMPARED)
    findings = findings_of(facts)
    return MetricsView(
        campaign_id=campaign_id,
        by_strategy=_rows(summaries(findings)),
        by_mapping=_rows(summaries(findings, ("strategy", "mapping"))),
        seed_yields=_rows(seed_yields(facts.solves)),
        seed_chains=_rows(seed_chains(findings)),
        paired_changes=_rows(paired_changes(findings)),
    )


def _rows(records: Iterable[Any]) -> list[MetricsRow]:
    return [row(record) for record in records]
