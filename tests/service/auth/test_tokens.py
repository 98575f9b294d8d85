import logging
import sqlite3

import pytest
from fastapi.testclient import TestClient

from service.api import events
from service.app import create_app
from service.auth.network import Access
from service.auth.rights import ANYONE, QUESTIONS, RIGHTS, least
from service.schemas.identity import Role
from service.settings import Settings
from service.store.errors import StoreError, UnknownRowError
from service.store.identity import (
    COOKIE,
    SESSION_S,
    RefusedTokenError,
    TakenNameError,
    hash_secret,
    new_secret,
    split_token,
)
from service.store.store import Store
from tests.api_examples import example_of
from tests.service.campaigns import spec_fields
from tests.service.routes import lines_of
from workers.messages import HeartbeatRequest

API = "/api/v1"
URL = "http://127.0.0.1:8741"
CLOSED = Access(is_open=False)
ROLES = list(Role)


class Clock:
    now = 1.8e9

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def store(tmp_path, clock):
    with Store(tmp_path, clock=clock) as opened:
        yield opened


@pytest.fixture
def client(store, monkeypatch):
    # A stream that is asked for its status alone need not stay open.
    monkeypatch.setattr(events, "LIFETIME_S", 0.0)
    app = create_app(store, access=CLOSED)
    with TestClient(app, base_url=URL, raise_server_exceptions=False, follow_redirects=False) as opened:
        yield opened


@pytest.fixture
def token(store):
    """Return a function that gives the written token of a role."""
    made = {}

    def written(role, name=None):
        if role not in made:
            made[role] = store.identities.create(name or f"a {role}", Role(role), 1.0).token
        return made[role]

    return written


def bearer(written):
    return {"Authorization": f"Bearer {written}"}


def rows(store, query):
    with sqlite3.connect(store.folder / "coastarc.db") as connection:
        return connection.execute(query).fetchall()


LINES = sorted(lines_of(create_app(None, access=Access())))
GUARDED = [line for line in LINES if RIGHTS.get(line, frozenset()) is not ANYONE]


def send(client, line, headers):
    method, path = line.replace("{}", "1").split(" ")
    body = {"json": {}} if method != "GET" else {}
    return client.request(method, path, headers=headers, **body)


def test_every_route_says_whom_it_is_for_and_nothing_else_does():
    assert set(LINES) == set(RIGHTS)


def test_pages_metrics_and_streams_are_among_the_routes_that_ask_for_a_token():
    assert {"GET /", "GET /metrics", f"GET {API}/campaigns/{{}}/events", f"HEAD {API}/openapi.json"} <= {
        *GUARDED
    }


def test_only_signing_in_health_and_static_files_are_for_anyone():
    public = {line for line in LINES if RIGHTS[line] is ANYONE}
    assert {line.split(" ")[1].removeprefix(API) for line in public} == {
        "/sign-in", "/sign-out", "/session", "/healthz", "/readyz", "/static/{}"
    }  # fmt: skip


@pytest.mark.parametrize("line", GUARDED)
def test_without_a_token_in_force_no_route_answers(client, store, clock, line):
    expired = store.identities.create("expired", Role.ADMIN, 1.0).token
    clock.now += 86401.0
    revoked = store.identities.create("revoked", Role.ADMIN, 1.0).token
    store.identities.revoke("revoked")
    good = store.identities.create("good", Role.ADMIN, 1.0).token
    # The last one has the id of a token in force, and a secret that differs in one sign.
    wrong = [
        new_secret().written(),
        "coastarc",
        "",
        f"{good}x",
        good[:-1] + ("A" if good[-1] != "A" else "B"),
    ]
    for headers in [{}, *map(bearer, [expired, revoked, *wrong]), {"Authorization": "Basic YTpi"}]:
        answer = send(client, line, headers)
        assert answer.status_code == 401 and answer.headers["www-authenticate"].startswith("Bearer")
        assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize("line", GUARDED)
@pytest.mark.parametrize("role", ROLES)
def test_a_route_answers_its_roles_and_names_the_one_it_needs_to_others(client, token, line, role):
    answer = send(client, line, bearer(token(role)))
    if role in RIGHTS[line]:
        assert answer.status_code not in (401, 403)
    else:
        assert answer.status_code == 403
        assert answer.headers["content-type"] == "application/problem+json"
        assert 'error="insufficient_scope"' in answer.headers["www-authenticate"]
        assert f"expected role {least(RIGHTS[line])}, got {role}" in answer.json()["detail"]


def test_a_worker_changes_nothing_but_its_jobs():
    asked = QUESTIONS | {line for line in RIGHTS if line.startswith(("GET", "HEAD"))}
    may = {line for line, roles in RIGHTS.items() if roles and Role.WORKER in roles}
    verbs = ("claim", "heartbeat", "hand-in", "complete", "complete-many")
    assert may - asked == {f"POST /api/v1/jobs/{verb}" for verb in verbs}


def test_a_route_without_a_line_is_for_nobody(store, token):
    app = create_app(store, access=CLOSED)
    app.add_api_route("/forgotten", lambda: 1)
    answer = TestClient(app, base_url=URL).get("/forgotten", headers=bearer(token("admin")))
    assert answer.status_code == 403 and "table of rights" in answer.json()["detail"]


def test_on_an_open_service_a_token_still_says_who_one_is(store, token):
    client = TestClient(create_app(store, access=Access()), base_url=URL)
    assert client.get(f"{API}/session").json() == {"name": "loopback", "role": "admin"}
    mine = client.get(f"{API}/session", headers=bearer(token("viewer")))
    assert mine.json() == {"name": "a viewer", "role": "viewer"}
    assert client.post(f"{API}/campaigns", json={}, headers=bearer(token("viewer"))).status_code == 403
    assert client.get(f"{API}/session", headers=bearer("nonsense")).status_code == 401


def test_a_secret_is_shown_once_and_only_its_hash_is_stored(client, store, token):
    fields = {"name": "ada", "role": "submitter", "days": 2}
    answer = client.post(f"{API}/tokens", json=fields, headers=bearer(token("admin")))
    written = answer.json()["token"]
    assert answer.status_code == 201 and client.get(f"{API}/session", headers=bearer(written)).json() == {
        "name": "ada", "role": "submitter"
    }  # fmt: skip
    listed = client.get(f"{API}/tokens", headers=bearer(token("admin"))).text
    secret = split_token(written).secret
    assert secret not in listed and "secret_hash" not in listed
    stored = str(rows(store, "SELECT * FROM token") + rows(store, "SELECT * FROM audit"))
    assert secret not in stored and hash_secret(secret) in stored


def test_two_secrets_are_never_the_same_and_have_256_bits():
    made = [new_secret() for _ in range(100)]
    assert len({secret.secret for secret in made}) == 100 and all(len(s.secret) == 43 for s in made)


def test_a_name_is_free_again_when_its_token_is_revoked(store):
    first = store.identities.create("ada", Role.VIEWER, 1.0)
    with pytest.raises(TakenNameError, match="expected a name that is not in use, got ada"):
        store.identities.create("ada", Role.ADMIN, 1.0)
    assert store.identities.revoke("ada").id == first.id
    store.identities.create("ada", Role.ADMIN, 1.0)
    assert [view.state for view in store.identities.tokens()].count("revoked") == 1
    with pytest.raises(UnknownRowError):
        store.identities.revoke("bob")


def test_replacing_a_token_ends_the_one_before(store):
    first = store.identities.replace("dispatcher", Role.WORKER, 1.0)
    second = store.identities.replace("dispatcher", Role.WORKER, 1.0)
    assert store.identities.identify(second.token).role is Role.WORKER
    with pytest.raises(RefusedTokenError):
        store.identities.identify(first.token)
    assert len(store.identities.tokens()) == 1
    # With worker tokens alone nobody could sign in.
    assert not store.identities.has_token()


def test_a_replaced_token_that_the_audit_names_stays_as_a_row(client, store):
    first = store.identities.replace("dispatcher", Role.WORKER, 1.0)
    client.post(f"{API}/campaigns", json={}, headers=bearer(first.token))
    store.identities.replace("dispatcher", Role.WORKER, 1.0)
    assert [view.state for view in store.identities.tokens() if view.id == first.id] == ["revoked"]
    with pytest.raises(
        RefusedTokenError, match="token dispatcher: expected one in force, got one that is revoked"
    ):
        store.identities.identify(first.token)


def test_the_last_use_is_stored_to_the_minute(store, clock, token):
    written = token("viewer")
    for seconds, used in ((0.0, 1.8e9), (59.0, 1.8e9), (61.0, 1.8e9 + 61)):
        clock.now = 1.8e9 + seconds
        store.identities.identify(written)
        assert rows(store, "SELECT last_used_at FROM token") == [(used,)]


def test_each_changing_request_is_in_the_audit_refused_or_not(client, store, token):
    client.post(f"{API}/campaigns", json=spec_fields(), headers=bearer(token("submitter")))
    client.post(f"{API}/campaigns", json=spec_fields(), headers=bearer(token("viewer")))
    client.post(f"{API}/campaigns", json=spec_fields())
    client.get(f"{API}/campaigns", headers=bearer(token("viewer")))
    page = client.get(f"{API}/audit", headers=bearer(token("admin"))).json()
    seen = [(row["actor"], row["method"], row["path"], row["status"]) for row in page["items"]]
    path = f"{API}/campaigns"
    assert seen == [
        ("nobody", "POST", path, 401), ("a viewer", "POST", path, 403), ("a submitter", "POST", path, 201)
    ]  # fmt: skip


def test_what_workers_do_is_in_the_audit_only_where_it_is_refused(client, store, token):
    url, headers = f"{API}/jobs/heartbeat", bearer(token("worker"))
    assert client.post(
        url, json=example_of(HeartbeatRequest).model_dump(mode="json"), headers=headers
    ).status_code in (200, 409)
    assert store.identities.audit(9).items == []
    client.post(url, json={}, headers=headers)
    client.post(f"{API}/campaigns", json={}, headers=headers)
    assert [row.status for row in store.identities.audit(9).items] == [403, 422]


def test_a_failure_of_ours_is_in_the_audit_too(client, store, token, monkeypatch):
    written = token("submitter")
    monkeypatch.setattr(store, "begin_campaign", None)
    answer = client.post(f"{API}/campaigns", json=spec_fields(), headers=bearer(written))
    assert answer.status_code == 500 and store.identities.audit(1).items[0].status == 500


def test_pages_of_the_audit_join(client, store, token):
    for _ in range(5):
        client.post(f"{API}/campaigns", json={}, headers=bearer(token("viewer")))
    first = store.identities.audit(3)
    rest = store.identities.audit(3, first.next)
    ids = [row.id for row in (*first.items, *rest.items)]
    assert ids == sorted(ids, reverse=True) and len(ids) == 5 and rest.next is None


def test_an_audit_that_cannot_be_written_does_not_take_the_answer_away(client, store, token, monkeypatch):
    def full(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr("service.store.identity.Identities.record", full)
    answer = client.post(f"{API}/campaigns", json=spec_fields(), headers=bearer(token("submitter")))
    assert answer.status_code == 201


def test_strangers_cannot_fill_the_audit(client, store):
    for _ in range(150):
        client.post(f"{API}/campaigns", json={})
    assert 100 <= len(store.identities.audit(200).items) < 110  # the burst, and what flowed back meanwhile


def test_a_token_is_traded_for_a_cookie_that_scripts_and_other_sites_cannot_use(client, token):
    answer = client.post(f"{API}/session", json={"token": token("viewer")})
    assert answer.status_code == 201 and answer.json() == {"name": "a viewer", "role": "viewer"}
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie and "SameSite=strict" in cookie and "Path=/" in cookie
    assert token("viewer") not in cookie and "Secure" not in cookie
    assert client.get(f"{API}/session").json()["role"] == "viewer"


def test_over_https_the_cookie_is_for_https_alone(store, token):
    client = TestClient(create_app(store, access=CLOSED), base_url=URL.replace("http", "https"))
    assert "Secure" in client.post(f"{API}/session", json={"token": token("viewer")}).headers["set-cookie"]


@pytest.mark.parametrize("body", [{"token": "nonsense"}, {"token": ""}, {"token": "x" * 9999}])
def test_no_cookie_for_what_is_no_token(client, body):
    answer = client.post(f"{API}/session", json=body)
    assert answer.status_code == 401 and "set-cookie" not in answer.headers


def test_a_session_is_no_token_and_a_token_no_session(client, store, token):
    value = store.identities.sign_in(token("admin"))[0]
    assert client.get(f"{API}/session", headers=bearer(value)).status_code == 401
    headers = {"cookie": f"{COOKIE}={token('admin')}"}
    assert client.get(f"{API}/session", headers=headers).status_code == 401


def test_a_session_ends_by_time_by_signing_out_and_with_its_token(client, store, clock, token):
    def status():
        return client.get(f"{API}/session").status_code

    client.post(f"{API}/session", json={"token": token("viewer")})
    clock.now += SESSION_S + 1
    assert status() == 401
    client.post(f"{API}/session", json={"token": token("viewer")})
    assert status() == 200 and client.delete(f"{API}/session", headers={"origin": URL}).status_code == 204
    assert rows(store, "SELECT count(*) FROM session") == [(0,)] and status() == 401
    client.post(f"{API}/session", json={"token": token("viewer")})
    store.identities.revoke("a viewer")
    assert status() == 401 and rows(store, "SELECT count(*) FROM session") == [(0,)]


def test_a_session_lives_no_longer_than_its_token(store):
    written = store.identities.create("short", Role.VIEWER, 0.1).token
    assert store.identities.sign_in(written)[1] == pytest.approx(8640)  # 0.1 d; rounding of 1.8e9 s


def test_a_change_with_a_cookie_needs_our_own_origin(client, token):
    client.post(f"{API}/session", json={"token": token("submitter")})
    post = {"url": f"{API}/campaigns", "json": spec_fields()}
    for headers in ({}, {"origin": "https://evil.example"}, {"origin": "null"}):
        answer = client.post(**post, headers=headers)
        assert answer.status_code == 403 and "Origin" in answer.json()["detail"]
    assert client.post(**post, headers={"origin": URL}).status_code == 201


def test_a_page_leads_to_signing_in_and_back(client, token):
    html = {"accept": "text/html"}
    away = client.get("/?campaign=1&x=2", headers=html)
    assert away.status_code == 303 and away.headers["location"] == "/sign-in?next=%2F%3Fcampaign%3D1%26x%3D2"
    form = client.get(away.headers["location"], headers=html)
    assert form.status_code == 200 and 'value="/?campaign=1&amp;x=2"' in form.text
    fields = {"token": f" {token('viewer')}\n", "next": "/?campaign=1&x=2"}
    back = client.post("/sign-in", data=fields, headers={"origin": URL})
    assert back.status_code == 303 and back.headers["location"] == "/?campaign=1&x=2"
    assert client.get("/", headers=html).status_code == 200
    out = client.post("/sign-out", headers={"origin": URL})
    assert out.headers["location"] == "/sign-in" and client.get("/", headers=html).status_code == 303


def test_a_wrong_token_is_asked_for_again(client):
    answer = client.post("/sign-in", data={"token": "nonsense"}, headers={"origin": URL})
    assert answer.status_code == 401 and "expected one that this service gave out" in answer.text
    assert "nonsense" not in answer.text


@pytest.mark.parametrize(
    "next", ["https://evil.example", "//evil.example", "/\\evil.example", "", "/a b", "x"]
)
def test_signing_in_leads_to_our_own_pages_alone(client, token, next):
    fields = {"token": token("viewer"), "next": next}
    assert client.post("/sign-in", data=fields, headers={"origin": URL}).headers["location"] == "/"


def test_where_no_sign_in_is_needed_its_page_goes_on(store):
    client = TestClient(create_app(store), base_url=URL, follow_redirects=False)
    assert client.get("/sign-in?next=/?campaign=1").headers["location"] == "/?campaign=1"


def test_workers_may_ask_more_often_than_people(store, token):
    limits = Settings(requests_per_second=0.1, request_burst=2, worker_request_burst=5)
    client = TestClient(create_app(store, access=Access(is_open=False, settings=limits)), base_url=URL)
    n = {role: sum(client.get(f"{API}/session", headers=bearer(token(role))).is_success for _ in range(5))
         for role in ("viewer", "worker")}  # fmt: skip
    assert n == {"viewer": 2, "worker": 5}


def test_no_secret_reaches_the_log(client, store, token, caplog, monkeypatch):
    caplog.set_level(logging.DEBUG)
    secret = token("admin")
    client.post(f"{API}/session", json={"token": secret})
    client.post("/sign-in", data={"token": secret}, headers={"origin": URL})
    client.post(f"{API}/session", json={"token": secret, "more": 1})
    client.get(f"{API}/campaigns", headers=bearer(secret + "x"))
    monkeypatch.setattr(store, "begin_campaign", None)
    client.post(f"{API}/campaigns", json=spec_fields(), headers=bearer(secret))
    sessions = [cookie.value for cookie in client.cookies.jar]
    assert sessions and not any(split_token(s).secret in caplog.text for s in (secret, *sessions))


def test_refusals_of_the_store_are_errors_of_the_store():
    assert issubclass(RefusedTokenError, StoreError) and issubclass(TakenNameError, StoreError)
