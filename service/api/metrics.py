"""What the strategies of a campaign are worth, from the archive alone."""

from collections.abc import Iterable
from typing import Any

from fastapi import APIRouter

from core.analysis.comparison import paired_changes
from core.analysis.seed_chains import seed_chains
from core.analysis.study import findings_of, row, seed_yields, summaries
from service.api.context import Id, StoreHere
from service.api.schemas import MetricsRow, MetricsView

router = APIRouter(tags=["campaigns"])


@router.get("/campaigns/{campaign_id}/metrics")
def get_metrics(campaign_id: Id, store: StoreHere) -> MetricsView:
    """Return ratios, costs, delta-v and seed chains of a campaign, finished or not, with 95 % intervals."""
    facts = store.campaign_facts(campaign_id)
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
