"""Whether the service is alive, and whether it can work."""

from fastapi import APIRouter, Response
from sqlalchemy.exc import SQLAlchemyError

from core.ephemeris.kernels import KernelError, furnish
from service.api.context import StoreHere
from service.api.schemas import Health
from service.db.errors import DatabaseError
from service.store import Store

router = APIRouter(tags=["health"])


@router.get("/healthz")
def healthz() -> Health:
    """Return that the process answers."""
    return Health(status="ok", checks={})


@router.get("/readyz", responses={503: {"model": Health}})
def readyz(store: StoreHere, response: Response) -> Health:
    """Return whether archive and kernels can be used."""
    checks = {"archive": _archive(store), "kernels": _kernels()}
    is_ready = all(result == "ok" for result in checks.values())
    response.status_code = 200 if is_ready else 503
    return Health(status="ok" if is_ready else "unavailable", checks=checks)


def _archive(store: Store) -> str:
    try:
        store.check()
    except SQLAlchemyError as error:
        return str(error.__cause__ or error).splitlines()[0]
    except DatabaseError as error:
        return str(error)
    return "ok"


def _kernels() -> str:
    try:
        furnish()
    except KernelError as error:
        return str(error)
    return "ok"
