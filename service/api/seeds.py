"""Seeds: which solutions would seed a search or a problem, and with which mappings."""

from typing import Annotated, Literal

from fastapi import APIRouter, HTTPException, Query

from service.api.context import CampaignWanted, Limit, SearchWanted, StoreHere
from service.schemas.solution import SeedPage
from service.spec.search_spec import SeedOrder
from service.store.seeds import SeedsWanted

router = APIRouter(tags=["seeds"])

ProblemWanted = Annotated[
    str | None, Query(pattern="^[0-9a-f]{32}$", description="Hash of the problem to be seeded")
]
Outages = Annotated[
    list[Annotated[str, Query(pattern=r"^\d{1,4}:\d{1,3}(\.\d{1,6})?$")]] | None,
    Query(
        max_length=100,
        description="Other outages than the problem's, each as segment:days",
        examples=[["24:1.0", "40:1.0"]],
    ),
]
SeedK = Annotated[int | None, Query(ge=0, le=2000, description="Outages of the seeds; any fewer if left out")]
Tolerance = Literal["strict", "paper"]
Mapping = Annotated[
    list[Annotated[str, Query(max_length=400)]] | None,
    Query(max_length=100, description="Rules that make guesses of seeds", examples=[["reference"]]),
]


@router.get("/seeds")
def list_seeds(
    store: StoreHere,
    campaign: CampaignWanted = None,
    search: SearchWanted = None,
    problem: ProblemWanted = None,
    outage: Outages = None,
    k: SeedK = None,
    order: SeedOrder | None = None,
    limit: Limit | None = None,
    tolerance: Tolerance | None = None,
    mapping: Mapping = None,
) -> SeedPage:
    """Return the solutions that would seed a search (`campaign` and `search`), or a problem (`problem`).

    A search brings its own order, tolerance and mappings, and tells which jobs it has planned already; for a
    problem the whole archive is looked through.
    """
    wanted = SeedsWanted(order, limit, tolerance, None if mapping is None else tuple(mapping))
    if problem is None and campaign is not None and search is not None and outage is None and k is None:
        return store.seeds_of_search(campaign, search, wanted)
    if problem is not None and campaign is None and search is None:
        outages = None if outage is None else [_outage(text) for text in outage]
        return store.seeds_of_problem(problem, outages, k, wanted)
    raise HTTPException(
        422,
        "seeds: expected campaign and search, or problem with outage and k if wanted, got another mixture",
    )


def _outage(text: str) -> tuple[int, float]:
    segment, days = text.split(":")
    return int(segment), float(days)
