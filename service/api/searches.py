"""One search of a campaign: how it is set up, and what became of its hops."""

from typing import Annotated

from fastapi import APIRouter, Query

from service.api.campaigns import SearchName
from service.api.context import After, Id, StoreHere
from service.schemas.search import HopsView, SearchDetail
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
