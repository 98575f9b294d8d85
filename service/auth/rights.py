"""Roles by route, denied by default; a request's route is resolved before it is dispatched.

Roles grow, viewer < submitter < admin; a worker stands apart: it reads, and claims, extends and completes
jobs, but changes nothing else.
"""

import re
from typing import Any

from fastapi.routing import iter_route_contexts
from starlette.routing import compile_path
from starlette.types import Scope

from service.dashboard.assets import VIEWS
from service.schemas.identity import Role

ANYONE = None
READERS = frozenset(Role)
SUBMITTERS = frozenset({Role.SUBMITTER, Role.ADMIN})
ADMINS = frozenset({Role.ADMIN})
WORKERS = frozenset({Role.WORKER, Role.ADMIN})

_API = "/api/v1"
#: Verb and path, with {} where a path has a parameter.
RIGHTS: dict[str, frozenset[Role] | None] = {
    **{f"GET {re.sub('{[^}]*}', '{}', view.path)}": READERS for view in VIEWS},
    "GET /static/{}": ANYONE,
    "GET /sign-in": ANYONE,
    "POST /sign-in": ANYONE,
    "POST /sign-out": ANYONE,
    "GET /healthz": ANYONE,
    "GET /readyz": ANYONE,
    "GET /metrics": READERS,
    f"GET {_API}/healthz": ANYONE,
    f"GET {_API}/readyz": ANYONE,
    f"GET {_API}/metrics": READERS,
    f"GET {_API}/openapi.json": READERS,
    f"HEAD {_API}/openapi.json": READERS,
    f"POST {_API}/session": ANYONE,
    f"DELETE {_API}/session": ANYONE,
    f"GET {_API}/session": READERS,
    f"GET {_API}/tokens": ADMINS,
    f"POST {_API}/tokens": ADMINS,
    f"DELETE {_API}/tokens/{{}}": ADMINS,
    f"GET {_API}/audit": ADMINS,
    f"GET {_API}/workers": READERS,
    f"GET {_API}/events": READERS,
    f"GET {_API}/events/stream": READERS,
    f"GET {_API}/problems": READERS,
    f"POST {_API}/problems": SUBMITTERS,
    f"GET {_API}/problems/{{}}": READERS,
    f"GET {_API}/problems/{{}}/structure": READERS,
    f"GET {_API}/problems/{{}}/family": READERS,
    f"GET {_API}/seeds": READERS,
    f"POST {_API}/specs/check": READERS,
    f"GET {_API}/specs/templates": READERS,
    f"GET {_API}/campaigns": READERS,
    f"POST {_API}/campaigns": SUBMITTERS,
    f"GET {_API}/campaigns/{{}}": READERS,
    f"GET {_API}/campaigns/{{}}/history": READERS,
    f"GET {_API}/campaigns/{{}}/spec": READERS,
    f"GET {_API}/campaigns/{{}}/events": READERS,
    f"GET {_API}/campaigns/{{}}/export": READERS,
    f"POST {_API}/campaigns/import": SUBMITTERS,
    f"GET {_API}/campaigns/{{}}/metrics": READERS,
    f"POST {_API}/campaigns/{{}}/pause": SUBMITTERS,
    f"POST {_API}/campaigns/{{}}/resume": SUBMITTERS,
    f"POST {_API}/campaigns/{{}}/cancel": SUBMITTERS,
    f"POST {_API}/campaigns/{{}}/priority": SUBMITTERS,
    f"POST {_API}/campaigns/{{}}/requeue": SUBMITTERS,
    f"GET {_API}/campaigns/{{}}/searches/{{}}": READERS,
    f"GET {_API}/campaigns/{{}}/searches/{{}}/hops": READERS,
    f"POST {_API}/campaigns/{{}}/searches/{{}}/pause": SUBMITTERS,
    f"POST {_API}/campaigns/{{}}/searches/{{}}/resume": SUBMITTERS,
    f"POST {_API}/campaigns/{{}}/searches/{{}}/cancel": SUBMITTERS,
    f"POST {_API}/campaigns/{{}}/searches/{{}}/weight": SUBMITTERS,
    f"POST {_API}/campaigns/{{}}/searches/{{}}/priority": SUBMITTERS,
    f"GET {_API}/solutions": READERS,
    f"GET {_API}/solutions/points": READERS,
    f"GET {_API}/solutions/clusters": READERS,
    f"GET {_API}/solutions/choices": READERS,
    f"GET {_API}/solutions/{{}}": READERS,
    f"GET {_API}/solutions/{{}}/trajectory": READERS,
    f"GET {_API}/solutions/{{}}/lineage": READERS,
    f"GET {_API}/solutions/{{}}/export": READERS,
    f"GET {_API}/solutions/{{}}/certificate": READERS,
    f"GET {_API}/solutions/{{}}/reproduction": READERS,
    f"GET {_API}/solutions/{{}}/missed-thrust": READERS,
    f"GET {_API}/attempts": READERS,
    f"GET {_API}/queue": READERS,
    f"GET {_API}/jobs": READERS,
    f"GET {_API}/jobs/{{}}": READERS,
    f"GET {_API}/jobs/{{}}/attempts": READERS,
    f"POST {_API}/jobs/{{}}/requeue": SUBMITTERS,
    f"POST {_API}/jobs/{{}}/cancel": SUBMITTERS,
    f"POST {_API}/jobs/claim": WORKERS,
    f"POST {_API}/jobs/heartbeat": WORKERS,
    f"POST {_API}/jobs/hand-in": WORKERS,
    f"POST {_API}/jobs/complete": WORKERS,
    f"POST {_API}/jobs/complete-many": WORKERS,
}
#: Answers that stay open; how many of them a token may have is limited.
STREAMS = frozenset({f"GET {_API}/campaigns/{{}}/events", f"GET {_API}/events/stream"})
#: Reads that take a large part of a second, or more; they have one turn between them.
HEAVY = frozenset(
    f"GET {_API}/{path}"
    for path in (
        "campaigns/{}/metrics",
        "campaigns/{}/history",
        "campaigns/{}/export",
        "campaigns/{}/searches/{}/hops",
        "seeds",
        "solutions/points",
        "solutions/clusters",
        "solutions/{}/missed-thrust",
    )
)
#: Reads for which a trajectory is flown.  The first after a start compiles for up to a minute, which readers
#: of the archive need not wait for, so these have a turn of their own.
FLIGHTS = frozenset(
    f"GET {_API}/{path}"
    for path in ("problems/{}/structure", "solutions/{}/trajectory", "solutions/{}/export")
)
#: Reads that never wait for others: they say whether the service is alive.
PROMPT = frozenset(f"GET {prefix}/{path}" for prefix in ("", _API) for path in ("healthz", "readyz"))
#: Bodies too large for memory: their routes read them piece by piece, one at a time for each client.
UPLOADS = frozenset({f"POST {_API}/campaigns/import"})
#: Asked by POST for the size of what they are asked about; they change nothing.
QUESTIONS = frozenset({f"POST {_API}/specs/check"})
#: Left out of the audit, whose rest they would bury: questions, and changes whose trail is the attempts.
UNLOGGED = QUESTIONS | {line for line, roles in RIGHTS.items() if roles == WORKERS}


def line_of(method: str, template: str) -> str:
    """Return the name of a route in `RIGHTS`."""
    return f"{method} {re.sub('{[^}]*}', '{}', template)}"


def least(roles: frozenset[Role]) -> str:
    """Return the role to ask for, if one wants to do what these roles may."""
    order = (Role.VIEWER, Role.WORKER, Role.SUBMITTER, Role.ADMIN)
    return next(role.value for role in order if role in roles)


class RouteIndex:
    """The routes of an application in the order in which it tries them; read at the first request."""

    def __init__(self) -> None:
        self._routes: list[tuple[re.Pattern[str], str, frozenset[str]]] | None = None

    def find(self, scope: Scope) -> tuple[str, frozenset[str]]:
        """Return the name of the route in `service.auth.rights`, or none and the verbs of the path."""
        if self._routes is None:
            self._routes = _routes_of(scope["app"])
        verbs: frozenset[str] = frozenset()
        for pattern, template, methods in self._routes:
            if pattern.match(scope["path"]):
                if scope["method"] in methods:
                    return line_of(scope["method"], template), methods
                verbs |= methods
        return "", verbs


def _routes_of(app: Any) -> list[tuple[re.Pattern[str], str, frozenset[str]]]:
    return [
        (compile_path(context.path)[0], context.path, frozenset(context.methods or ()))
        for context in iter_route_contexts(app.routes)
        if context.path is not None
    ]
