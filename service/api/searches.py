"""Routes of one search: its settings, its hops, and the seeds that it would take."""

from typing import Annotated, Literal

from fastapi import APIRouter, HTTPException, Query

from service.api.campaigns import SearchName
from service.api.context import After, CampaignWanted, Id, Limit, SearchWanted, StoreHere
from service.schemas.search import HopsView, SearchDetail
from service.schemas.solution import SeedPage
from service.spec.search_spec import SeedOrder
from service.spec.spec import SeedChoices
from service.store.jobs import MOST

router = APIRouter(tags=["campaigns"])


@router.get("/campaigns/{campaign_id}/searches/{name}")
def get_search(campaign_id: Id, name: SearchName, store: StoreHere) -> SearchDetail:
    """Return a search with its laws, its budget and its counts."""
    return store.activity.search(campaign_id, name)


@router.get("/campaigns/{campaign_id}/searches/{name}/hops")
def list_hops(
    campaign_id: Id,
    name: SearchName,
    store: StoreHere,
    limit: Annotated[int, Query(ge=1, le=MOST)] = MOST,
    after: After = 0,
) -> HopsView:
    """Return the solves of a search, chain by chain, as lists that are equally long.

    If there are more than `limit`, whole chains are drawn evenly, the same ones each time; `n_all` says of
    how many solves.  With `after`, the `last` of an earlier answer, come the chains that have grown since.
    """
    return store.activity.hops(campaign_id, name, limit, after)


seeds_router = APIRouter(tags=["seeds"])

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


@seeds_router.get("/seeds")
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
    wanted = SeedChoices(order, limit, tolerance, None if mapping is None else tuple(mapping))
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
