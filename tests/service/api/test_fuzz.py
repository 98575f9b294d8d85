"""Bodies and credentials that no schema describes: accepted or refused, but never a failure of the service.

`test_api_schema` asks every operation what its schema describes.
"""

import copy
import json
from urllib.parse import quote

import pytest
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from service.app import create_app
from service.auth.network import Access
from service.schemas.identity import Role
from service.settings import Settings
from service.store.identity import COOKIE
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


#: Header values as HTTP lets them through: one line of bytes.
HEADER_VALUES = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=90)
WRITTEN = st.from_regex(r"coastarc_[0-9a-f]{12}_[A-Za-z0-9_-]{43}", fullmatch=True)


@pytest.fixture
def stranger(store):
    """Return a client of a service that asks for tokens and knows one that nobody has."""
    store.identities.create("ada", Role.ADMIN, 1.0)
    limits = Settings(request_burst=100_000)
    app = create_app(store, access=Access(is_open=False, settings=limits))
    with TestClient(app, base_url="http://127.0.0.1:8741", raise_server_exceptions=False) as client:
        yield client


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    method=st.sampled_from(["GET", "POST", "PUT", "PATCH", "DELETE", "HEAD", "OPTIONS", "TRACE", "get"]),
    path=st.sampled_from(
        ["/campaigns", "/tokens", "/jobs/claim", "/audit", "/campaigns/1/events", "//tokens"]
    )
    | st.text(max_size=20).map(lambda text: f"/{quote(text)}"),
    authorization=st.none() | HEADER_VALUES | (HEADER_VALUES | WRITTEN).map("Bearer {}".format),
    cookie=st.none() | (HEADER_VALUES | WRITTEN).map(f"{COOKIE}={{}}".format),
)
def test_no_credentials_but_the_right_ones_get_in_or_break_the_service(
    stranger, method, path, authorization, cookie
):
    given_headers = {"authorization": authorization, "cookie": cookie}
    headers = {name: value for name, value in given_headers.items() if value is not None}
    answer = stranger.request(method, f"/api/v1{path}", headers=headers)
    assert answer.status_code in (401, 403, 404, 405), answer.text
    assert answer.headers["content-type"] == "application/problem+json"


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(body=st.binary(max_size=60) | st.text(max_size=40).map(lambda text: f"token={quote(text)}".encode()))
def test_no_sign_in_form_breaks_the_service(stranger, body):
    for path, kind in (("/sign-in", "x-www-form-urlencoded"), ("/api/v1/session", "json")):
        answer = stranger.post(path, content=body, headers={"content-type": f"application/{kind}"})
        assert answer.status_code in (400, 401, 422), answer.text
        assert "set-cookie" not in answer.headers
