"""Campaigns: submit one, see how far one is, and steer it.

A campaign is active, paused, done or cancelled; a search may also wait for seeds.  Pausing lets running jobs
finish; cancelling has them stopped, and is for good.  Asking for what is so already changes nothing, what
cannot be from the present state is refused with 409.
"""

from typing import Annotated, Any

from fastapi import APIRouter, BackgroundTasks, Body, Header, Path, Request, Response

from service.api.context import HeavyHere, Id, StoreHere
from service.api.jobs import CONFLICT
from service.schemas.campaign import CampaignView
from service.schemas.search import PriorityWanted, WeightWanted
from service.spec import spec_from
from service.spec.spec import require_flyable
from service.store import Store

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

Key = Annotated[str | None, Header(pattern="^[!-~]{1,200}$", description="Unique for each submission")]
SearchName = Annotated[
    str, Path(pattern="^[A-Za-z0-9][A-Za-z0-9 ._-]{0,79}$", description="Name of a search")
]
Weight = Annotated[WeightWanted, Body(examples=[{"weight": 2.0}])]
Priority = Annotated[PriorityWanted, Body(examples=[{"priority": -1}])]


@router.post(
    "/campaigns",
    status_code=201,
    responses={200: {"model": CampaignView}, 202: {"model": CampaignView}, **CONFLICT},
)
async def submit_campaign(
    spec: Annotated[dict[str, Any], Body(examples=[EXAMPLE])],
    store: StoreHere,
    heavy: HeavyHere,
    request: Request,
    response: Response,
    afterwards: BackgroundTasks,
    idempotency_key: Key = None,
) -> CampaignView:
    """Submit a campaign; the same specification again is the same campaign (200).

    A large one is answered (202) before all of its jobs are planned: a search waits until its own are.
    With an `Idempotency-Key` another specification under the same key is refused (409, `key_reused`).
    """
    view, is_new, is_planned = await heavy.run(_submitted, store, spec, idempotency_key)
    response.status_code = (201 if is_planned else 202) if is_new else 200
    if not is_planned:
        # What is cut off by the end of the process, the next coordinator of the archive plans.
        afterwards.add_task(store.plan_rest, view.id, request.app.state.is_closing)
    response.headers["location"] = f"/api/v1/campaigns/{view.id}"
    return view


def _submitted(store: Store, spec: dict[str, Any], key: str | None) -> tuple[CampaignView, bool, bool]:
    specification = spec_from(spec)
    require_flyable(specification.problem)
    campaign_id, is_new = store.begin_campaign(specification, key)
    return store.campaign(campaign_id), is_new, not store.unplanned(campaign_id)


@router.get("/campaigns/{campaign_id}")
def get_campaign(campaign_id: Id, store: StoreHere) -> CampaignView:
    """Return a campaign with its searches and how far they are."""
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/pause", responses=CONFLICT)
def pause_campaign(campaign_id: Id, store: StoreHere) -> CampaignView:
    """Hand out no more jobs of a campaign; those that run finish."""
    store.control_campaign(campaign_id, "pause")
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/resume", responses=CONFLICT)
def resume_campaign(campaign_id: Id, store: StoreHere) -> CampaignView:
    """Let a paused campaign go on."""
    store.control_campaign(campaign_id, "resume")
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/cancel", responses=CONFLICT)
def cancel_campaign(campaign_id: Id, store: StoreHere) -> CampaignView:
    """End a campaign for good, and have its running jobs stopped; all results are kept."""
    store.control_campaign(campaign_id, "cancel")
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/priority")
def set_campaign_priority(campaign_id: Id, wanted: Priority, store: StoreHere) -> CampaignView:
    """Let a campaign go before others or after them; lower goes first, 0 is usual."""
    store.set_campaign(campaign_id, priority=wanted.priority)
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/searches/{name}/pause", responses=CONFLICT)
def pause_search(campaign_id: Id, name: SearchName, store: StoreHere) -> CampaignView:
    """Hand out no more jobs of a search; those that run finish."""
    store.control_search(campaign_id, name, "pause")
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/searches/{name}/resume", responses=CONFLICT)
def resume_search(campaign_id: Id, name: SearchName, store: StoreHere) -> CampaignView:
    """Let a paused search go on."""
    store.control_search(campaign_id, name, "resume")
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/searches/{name}/cancel", responses=CONFLICT)
def cancel_search(campaign_id: Id, name: SearchName, store: StoreHere) -> CampaignView:
    """End a search for good; searches that take its seeds go on with what it has found."""
    store.control_search(campaign_id, name, "cancel")
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/searches/{name}/weight")
def set_search_weight(campaign_id: Id, name: SearchName, wanted: Weight, store: StoreHere) -> CampaignView:
    """Give a search another part of the workers, compared with searches of equal priority."""
    store.set_search(campaign_id, name, weight=wanted.weight)
    return store.campaign(campaign_id)


@router.post("/campaigns/{campaign_id}/searches/{name}/priority")
def set_search_priority(
    campaign_id: Id, name: SearchName, wanted: Priority, store: StoreHere
) -> CampaignView:
    """Let a search go before others or after them; lower goes first, -k is usual for S(k|k')."""
    store.set_search(campaign_id, name, priority=wanted.priority)
    return store.campaign(campaign_id)
