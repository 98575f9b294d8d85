"""The archive at a glance: its solutions as points, in clusters, and what they can be filtered by."""

from typing import Annotated

from fastapi import APIRouter, Query

from core.analysis.similarity import DISTINCT
from service.api.context import CampaignWanted, StoreHere
from service.api.solution_filter import FilterWanted
from service.schemas.solution import ChoicesView, ClusterPage, PointsView

router = APIRouter(tags=["solutions"])

#: Points that a page can draw.
MOST_POINTS = 5000


@router.get("/solutions/points")
def list_points(
    store: StoreHere,
    wanted: FilterWanted,
    most: Annotated[int, Query(ge=100, le=MOST_POINTS, description="Points at most")] = MOST_POINTS,
) -> PointsView:
    """Return solutions as points; of too many a sample, with the extremes and the front among it."""
    return store.points(wanted, most)


@router.get("/solutions/clusters")
def list_clusters(
    store: StoreHere,
    wanted: FilterWanted,
    threshold: Annotated[
        float, Query(ge=0, le=10, allow_inf_nan=False, description="Greatest distance in a cluster [-]")
    ] = DISTINCT,
    limit: Annotated[int, Query(ge=1, le=200)] = 50,
) -> ClusterPage:
    """Return which solutions are alike, among the 2,000 with the least delta-v."""
    return store.clusters(wanted, threshold, limit)


@router.get("/solutions/choices")
def list_choices(store: StoreHere, campaign: CampaignWanted = None) -> ChoicesView:
    """Return the campaigns, and the searches, strategies and outages that a filter can name."""
    return store.choices(campaign)
