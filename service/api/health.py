"""Whether the service is alive, and whether campaigns would go on now."""

import time
from collections.abc import Callable
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse
from sqlalchemy.exc import SQLAlchemyError

from core.ephemeris.kernels import kernel_paths
from service.api import prometheus
from service.api.context import StoreHere
from service.db.engine import DatabaseError
from service.schemas.answer import Fault, Health
from service.store import Store

router = APIRouter(tags=["health"])
router.include_router(prometheus.router)

#: How long an answer about readiness stands [s]: anybody may ask, and to ask is to write.
KEPT_S = 2.0

CHECKS = {"archive": "ok", "dispatcher": "ok", "kernels": "ok"}
READY: dict[str, Any] = {"status": "ok", "checks": CHECKS}
NO_DISPATCHER = "expected one seen within 30 s, got none; start one with `coastarc dispatch`"
#: ... by a coordinator whose own should run.
NOT_STARTED = "the coordinator cannot start its own, got {}; it tries again by itself"


class Unready(Fault):
    """What stands in the way, part by part."""

    checks: dict[str, str]


UNREADY = {
    "type": "about:blank",
    "title": "Service Unavailable",
    "status": 503,
    "detail": f"dispatcher: {NO_DISPATCHER}",
    "checks": CHECKS | {"dispatcher": NO_DISPATCHER},
}


@router.get(
    "/healthz",
    responses={200: {"content": {"application/json": {"example": {"status": "ok", "checks": {}}}}}},
)
def healthz() -> Health:
    """Return that the process answers."""
    return Health(status="ok", checks={})


@router.get(
    "/readyz",
    response_model=Health,
    responses={
        200: {"content": {"application/json": {"example": READY}}},
        503: {"model": Unready, "content": {"application/problem+json": {"example": UNREADY}}},
    },
)
def readyz(store: StoreHere, request: Request) -> Any:
    """Return whether the archive takes a write, a dispatcher was seen lately, and the kernels are there."""
    until, checks = getattr(request.app.state, "readiness", (0.0, {}))
    if time.monotonic() >= until:
        checks = _checked(store, request.app.state.trouble())
        request.app.state.readiness = (time.monotonic() + KEPT_S, checks)
    faults = [f"{name}: {found}" for name, found in checks.items() if found != "ok"]
    if not faults:
        return Health(status="ok", checks=checks)
    body = Unready(title="Service Unavailable", status=503, detail="; ".join(faults), checks=checks)
    content = body.model_dump(exclude_none=True)
    return JSONResponse(content, status_code=503, media_type="application/problem+json")


def _checked(store: Store, trouble: str | None) -> dict[str, str]:
    looks: dict[str, Callable[[Store], str]] = {
        "archive": _archive,
        "dispatcher": lambda store: _dispatcher(store, trouble),
        "kernels": _kernels,
    }
    return {name: look(store) for name, look in looks.items()}


def _archive(store: Store) -> str:
    try:
        store.check()
    except (DatabaseError, SQLAlchemyError):
        # Anybody may read this; where the archive is and what it said is in the log.
        return "expected to take a write, got a fault; see the log"
    return "ok"


def _dispatcher(store: Store, trouble: str | None) -> str:
    try:
        is_there = store.gauges.n_workers() > 0
    except (DatabaseError, SQLAlchemyError):
        return "expected an archive that tells, got a fault; see the log"
    if is_there:
        return "ok"
    said = NO_DISPATCHER.replace("30 s", f"{store.leases.lease_s:g} s")
    return said if trouble is None else f"{said.partition('; ')[0]}; {NOT_STARTED.format(trouble)}"


def _kernels(_: Store) -> str:
    missing = [path.name for path in kernel_paths() if not path.is_file()]
    return f"expected the SPICE kernels, got no {', '.join(missing)}" if missing else "ok"
