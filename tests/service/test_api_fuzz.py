"""Requests with one value replaced by another: accepted or refused, but never a failure of the service."""

import copy
import json

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.service.campaigns import spec_fields

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.just("S(1|0)"),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=5,
)


def places(value, path=()):
    """Yield the path of every value in nested plain data."""
    yield path
    if not isinstance(value, dict | list):
        return
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
        yield from places(inner, (*path, key))


FIELDS = spec_fields(problem={"preset": "ppe-drm3", "target": {"kind": "nrho", "period_days": 6.5}})
FIELDS["search"][1]["seeds"] |= {"order": "delta_v", "limit": 3}
PLACES = [path for path in places(FIELDS) if path]


def replaced(path, value):
    fields = copy.deepcopy(FIELDS)
    place = fields
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return fields


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(path=st.sampled_from(PLACES), value=VALUES)
def test_no_specification_breaks_the_service(client, path, value):
    body = json.dumps(replaced(path, value))
    answer = client.post("/api/v1/campaigns", content=body, headers={"content-type": "application/json"})
    assert answer.status_code in (200, 201, 422), answer.text
    if answer.status_code == 422:
        assert answer.headers["content-type"] == "application/problem+json"


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    path=st.sampled_from(["/campaigns", "/solutions", "/problems", "/jobs", "/events"]),
    name=st.sampled_from(["campaign", "search", "strict", "limit", "after", "state"]),
    value=st.text(max_size=12) | st.integers().map(str) | st.floats().map(str),
)
def test_no_query_breaks_the_service(client, path, name, value):
    assert client.get(f"/api/v1{path}", params={name: value}).status_code in (200, 422)
