"""Dependencies of the routes: the store, the identity of the client, and bounds of parameters."""

from typing import Annotated

from fastapi import Depends, Path, Query, Request

from service.auth.network import Access
from service.auth.request_limits import HeavyWork
from service.store.identity import Identity
from service.store.store import Store


def _store(request: Request) -> Store:
    store: Store = request.app.state.store
    return store


def _access(request: Request) -> Access:
    access: Access = request.app.state.access
    return access


async def _heavy(request: Request) -> HeavyWork:
    heavy: HeavyWork = request.app.state.heavy
    return heavy


def _identity(request: Request) -> Identity:
    # Set by `service.auth.guard`, which lets nobody through without.
    identity: Identity = request.state.identity
    return identity


StoreHere = Annotated[Store, Depends(_store)]
AccessHere = Annotated[Access, Depends(_access)]
#: Where a route runs that keeps a processor busy for seconds.
HeavyHere = Annotated[HeavyWork, Depends(_heavy)]
#: Who asks: for routes whose line in `service.auth.rights` names roles.
IdentityHere = Annotated[Identity, Depends(_identity)]
#: Ids fit into the database's integers.
Id = Annotated[int, Path(ge=1, lt=2**63)]
After = Annotated[int, Query(ge=0, lt=2**63)]
CampaignWanted = Annotated[int | None, Query(ge=1, lt=2**63, description="Id of a campaign")]
SearchWanted = Annotated[str | None, Query(max_length=80, description="Name of a search")]
Hash = Annotated[str, Path(pattern="^[0-9a-f]{32}$", description="32 hexadecimal digits")]
Limit = Annotated[int, Query(ge=1, le=200)]
