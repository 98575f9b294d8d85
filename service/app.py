"""The web application: routes, middleware and the page."""

from collections.abc import Callable
from functools import cache
from importlib.metadata import version

from fastapi import APIRouter, FastAPI
from fastapi.middleware.gzip import GZipMiddleware
from starlette.routing import BaseRoute

from service.api import (
    campaigns,
    events,
    health,
    identity,
    jobs,
    metrics,
    pages,
    problems,
    searches,
    solutions,
)
from service.api.document import finish_document
from service.auth.guard import Guard, Streams
from service.auth.network import Access, access_on
from service.auth.request_limits import HeavyWork
from service.errors import REFUSALS, add_error_handlers
from service.settings import Settings
from service.store.store import Store

ROUTERS = (
    campaigns.router,
    problems.specs_router,
    metrics.router,
    solutions.router,
    problems.router,
    searches.router,
    jobs.router,
    events.router,
    searches.seeds_router,
    identity.router,
    identity.tokens_router,
)


def create_app(
    store: Store, is_closing: Callable[[], bool] = lambda: False, access: Access | None = None
) -> FastAPI:
    """Return the application on a store; `is_closing` ends the event streams so that a server can stop.

    Without `access` the service is for loopback, with or without sign-in as the environment says.
    """
    if access is None:
        access = access_on("127.0.0.1", Settings.from_environment(), store.identities.has_token)
    app = FastAPI(
        title="coastarc",
        description="Global search for low-thrust trajectories that survive missed-thrust events.",
        version=version("coastarc"),
        docs_url=None,
        redoc_url=None,
        openapi_url="/api/v1/openapi.json",
    )
    app.state.store = store
    app.state.is_closing = is_closing
    app.state.heavy = HeavyWork()
    app.state.access = access
    #: Why a coordinator's own dispatcher does not run, in words for everybody; set by the coordinator.
    app.state.trouble = lambda: None
    app.state.tables = metrics.Tables()
    add_error_handlers(app)
    app.router.routes.extend(_routes())
    finish_document(app)
    app.state.streams = Streams(access.settings.streams_per_client)
    # A trajectory shrinks to a third; streams of events stay as they are.
    app.add_middleware(GZipMiddleware, minimum_size=2000, compresslevel=5)
    app.add_middleware(Guard, store=store, access=access, streams=app.state.streams)
    return app


@cache
def _routes() -> list[BaseRoute]:
    """Return all routes, shared by the applications of a process: FastAPI takes 0.3 s to read them."""
    every = APIRouter(responses=REFUSALS)
    for router in ROUTERS:
        every.include_router(router, prefix="/api/v1")
    every.include_router(health.router)
    every.include_router(health.router, prefix="/api/v1", include_in_schema=False)
    every.include_router(pages.router)
    every.include_router(identity.pages)
    return every.routes
