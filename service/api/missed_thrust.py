"""How a solution takes outages, from the archive alone."""

from typing import Annotated

from fastapi import APIRouter, Query

from service.api.context import CampaignWanted, Hash, StoreHere
from service.missed_thrust.views import views_of
from service.schemas.solution import MissedThrustPage

router = APIRouter(tags=["solutions"])


@router.get("/solutions/{solution_id}/missed-thrust")
def list_missed_thrust(
    solution_id: Hash,
    store: StoreHere,
    campaign: CampaignWanted = None,
    limit: Annotated[int, Query(ge=1, le=10)] = 1,
) -> MissedThrustPage:
    """Return the newest missed-thrust analyses of a solution, or that of one campaign, finished or not."""
    return MissedThrustPage(items=views_of(store, solution_id, campaign, limit))
