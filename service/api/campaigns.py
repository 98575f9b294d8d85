"""Campaigns: submit one, list them, see how far one is."""

from typing import Annotated, Any

from fastapi import APIRouter, Body, Response

from service.api.context import Id, StoreHere
from service.api.schemas import CampaignPage, CampaignView
from service.resolve import require_flyable
from service.spec import spec_from

router = APIRouter(tags=["campaigns"])

EXAMPLE = {
    "campaign": {"name": "quick", "rng_seed": 2026},
    "problem": {"preset": "ppe-drm3", "n_segments": 50},
    "search": [
        {"id": "s0", "strategy": "S(0)", "guesses": 40, "max_iterations": 1200},
        {
            "id": "s1-0",
            "strategy": "S(1|0)",
            "outages": [{"segment": 24, "duration_days": 1.0}],
            "seeds": {"from": "s0"},
            "mapping": "continued",
            "max_iterations": 1200,
        },
    ],
}


@router.get("/campaigns")
def list_campaigns(store: StoreHere) -> CampaignPage:
    """Return the campaigns, the newest first."""
    return CampaignPage(items=store.campaigns())


@router.post("/campaigns", status_code=201, responses={200: {"model": CampaignView}})
def submit_campaign(
    spec: Annotated[dict[str, Any], Body(examples=[EXAMPLE])], store: StoreHere, response: Response
) -> CampaignView:
    """Submit a campaign; the same specification again is the same campaign (200)."""
    specification = spec_from(spec)
    require_flyable(specification)
    campaign_id, is_new = store.submit(specification)
    response.status_code = 201 if is_new else 200
    response.headers["location"] = f"/api/v1/campaigns/{campaign_id}"
    return store.campaign(campaign_id)


@router.get("/campaigns/{campaign_id}")
def get_campaign(campaign_id: Id, store: StoreHere) -> CampaignView:
    """Return a campaign with its searches and how far they are."""
    return store.campaign(campaign_id)
