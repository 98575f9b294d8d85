"""Campaigns as the dashboard shows them: a list with progress, and how one came to what it has found."""

from fastapi import APIRouter

from service.api.context import Id, StoreHere
from service.schemas.campaign import CampaignCards, HistoryView

router = APIRouter(tags=["campaigns"])


@router.get("/campaigns")
def list_campaigns(store: StoreHere) -> CampaignCards:
    """Return the campaigns, the newest first, each with how far it is and what it has found."""
    return CampaignCards(items=store.campaign_cards())


@router.get("/campaigns/{campaign_id}/history")
def get_history(campaign_id: Id, store: StoreHere) -> HistoryView:
    """Return improvements, outcomes over time, seeds and delta-v of a campaign, finished or not.

    `n_read` is smaller than `n_solves` for a few requests after a start, while a large archive is read.
    """
    return store.campaign_history(campaign_id)
