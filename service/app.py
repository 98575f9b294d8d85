"""The coordinator's HTTP side: one factory that puts routes, guards and the page together."""

from collections.abc import Callable
from importlib.metadata import version

from fastapi import FastAPI

from service.api import campaigns, events, health, jobs, metrics, pages, problems, solutions
from service.api.errors import REFUSALS, add_error_handlers
from service.security import Guard
from service.store import Store

ROUTERS = (campaigns.router, metrics.router, solutions.router, problems.router, jobs.router, events.router)


def create_app(store: Store, is_closing: Callable[[], bool] = lambda: False) -> FastAPI:
    """Return the application on a store; `is_closing` ends the event streams so that a server can stop."""
    app = FastAPI(
        title="coastarc",
        description="Global search for low-thrust trajectories that survive missed-thrust events.",
        version=version("coastarc"),
        docs_url=None,
        redoc_url=None,
        openapi_url="/api/v1/openapi.json",
        responses=REFUSALS,
    )
    app.state.store = store
    app.state.is_closing = is_closing
    add_error_handlers(app)
    for router in ROUTERS:
        app.include_router(router, prefix="/api/v1")
    app.include_router(health.router)
    app.include_router(health.router, prefix="/api/v1", include_in_schema=False)
    app.include_router(pages.router)
    app.add_middleware(Guard)
    return app
