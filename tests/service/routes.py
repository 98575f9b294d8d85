"""The routes of an application, for tests of each."""

from fastapi.routing import iter_route_contexts

from service.auth.rights import line_of


def lines_of(app):
    """Return the names of all routes of an application, such as "GET /api/v1/jobs/{}"."""
    contexts = [context for context in iter_route_contexts(app.routes) if context.path is not None]
    return [line_of(method, context.path) for context in contexts for method in context.methods or ()]
