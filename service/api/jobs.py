"""Jobs and how they stand."""

from fastapi import APIRouter

from service.api.context import After, CampaignWanted, Limit, SearchWanted, StoreHere
from service.api.schemas import JobPage, JobState

router = APIRouter(tags=["jobs"])


@router.get("/jobs")
def list_jobs(
    store: StoreHere,
    campaign: CampaignWanted = None,
    search: SearchWanted = None,
    state: JobState | None = None,
    limit: Limit = 50,
    after: After = 0,
) -> JobPage:
    """Return jobs in order of id."""
    return store.jobs(campaign, search, state, limit, after)
