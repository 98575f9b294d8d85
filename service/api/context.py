"""What routes are given: the store, and whether the service is about to stop."""

from typing import Annotated

from fastapi import Depends, Path, Query, Request

from service.store import Store


def _store(request: Request) -> Store:
    store: Store = request.app.state.store
    return store


StoreHere = Annotated[Store, Depends(_store)]
#: Ids fit into the database's integers.
Id = Annotated[int, Path(ge=1, lt=2**63)]
After = Annotated[int, Query(ge=0, lt=2**63)]
CampaignWanted = Annotated[int | None, Query(ge=1, lt=2**63, description="Id of a campaign")]
SearchWanted = Annotated[str | None, Query(max_length=80, description="Name of a search")]
Hash = Annotated[str, Path(pattern="^[0-9a-f]{32}$", description="32 hexadecimal digits")]
Limit = Annotated[int, Query(ge=1, le=200)]
