"""Which route of the application a request will reach, told before the application is asked."""

import re
from typing import Any

from fastapi.routing import iter_route_contexts
from starlette.routing import compile_path
from starlette.types import Scope

from service.access.rights import line_of


class RouteIndex:
    """The routes of an application in the order in which it tries them; read at the first request."""

    def __init__(self) -> None:
        self._routes: list[tuple[re.Pattern[str], str, frozenset[str]]] | None = None

    def find(self, scope: Scope) -> tuple[str, frozenset[str]]:
        """Return the name of the route in `service.access.rights`, or none and the verbs of the path."""
        if self._routes is None:
            self._routes = _routes_of(scope["app"])
        verbs: frozenset[str] = frozenset()
        for pattern, template, methods in self._routes:
            if pattern.match(scope["path"]):
                if scope["method"] in methods:
                    return line_of(scope["method"], template), methods
                verbs |= methods
        return "", verbs


def lines_of(app: Any) -> list[str]:
    """Return the names of all routes of an application."""
    return [line_of(method, template) for _, template, methods in _routes_of(app) for method in methods]


def _routes_of(app: Any) -> list[tuple[re.Pattern[str], str, frozenset[str]]]:
    return [
        (compile_path(context.path)[0], context.path, frozenset(context.methods or ()))
        for context in iter_route_contexts(app.routes)
        if context.path is not None
    ]
