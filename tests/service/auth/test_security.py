import httpx
import pytest
from fastapi.testclient import TestClient

from service.app import create_app
from service.auth.guard import MAX_CLIENTS, Buckets, Streams
from service.auth.network import Access, BindError, access_on
from service.coordinator import WebServer, open_port
from service.schemas.identity import Role
from service.settings import Settings
from tests.service.campaigns import spec_fields

CAMPAIGNS = "/api/v1/campaigns"
URL = "http://127.0.0.1:8741"


def no_token():
    return False


def client_of(store, access, url=URL, peer="127.0.0.1"):
    app = create_app(store, access=access)
    return TestClient(app, base_url=url, client=(peer, 50000), raise_server_exceptions=False)


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.2", "::1", "localhost"])
def test_on_this_machine_no_sign_in_is_asked_for(host):
    assert access_on(host, Settings(), no_token).is_open


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.5", "example.org", ""])
def test_another_address_without_a_token_is_refused_with_a_remedy(host):
    with pytest.raises(
        BindError, match=r"expected a token, got none; create one with `coastarc token create"
    ):
        access_on(host, Settings(), no_token)
    assert not access_on(host, Settings(), lambda: True).is_open


@pytest.mark.parametrize("settings", [Settings(auth="required"), Settings(proxies=("127.0.0.1",))])
def test_a_shared_machine_or_a_proxy_asks_for_tokens_on_loopback_too(settings):
    with pytest.raises(BindError, match="expected a token"):
        access_on("127.0.0.1", settings, no_token)
    assert not access_on("127.0.0.1", settings, lambda: True).is_open


def test_sign_in_required_by_the_environment_holds_without_being_passed(store, monkeypatch):
    monkeypatch.setenv("COASTARC_AUTH", "required")
    with pytest.raises(BindError):
        create_app(store)


@pytest.mark.parametrize("host", ["127.0.0.1:8741", "localhost", "LOCALHOST:1", "[::1]:8741"])
def test_our_own_names_are_answered(client, host):
    assert client.get(CAMPAIGNS, headers={"host": host}).status_code == 200


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example", "[::2]", "evil.example:127.0.0.1", ""]
)
def test_another_name_is_refused_even_for_reading(client, host):
    answer = client.get(CAMPAIGNS, headers={"host": host})
    assert answer.status_code == 403 and answer.headers["content-type"] == "application/problem+json"


def test_names_of_a_service_for_others_are_those_configured_and_its_own_address(store):
    access = access_on("0.0.0.0", Settings(hosts=("Coast.example",)), lambda: True)
    client = client_of(store, access, url="http://10.0.0.7:8741", peer="10.0.0.9")
    for host, status in (("coast.example", 200), ("10.0.0.7:8741", 200), ("evil.example", 403), ("", 403)):
        assert client.get("/healthz", headers={"host": host}).status_code == status


def test_an_open_service_answers_this_machine_alone(store):
    assert client_of(store, Access(), peer="192.168.1.5").get(CAMPAIGNS).status_code == 403


def test_a_form_of_another_site_is_refused_and_ours_is_not(client):
    url, fields = CAMPAIGNS, spec_fields()
    for origin in ("https://evil.example", "null", "http://127.0.0.1:9999", "file://127.0.0.1:8741"):
        foreign = client.post(url, json=fields, headers={"origin": origin})
        assert foreign.status_code == 403 and "Origin" in foreign.json()["detail"]
    own = client.post(url, json=fields, headers={"origin": URL})
    assert own.status_code == 201


def test_a_proxy_on_this_machine_is_believed_and_nobody_else(store):
    """Over a real connection, since a web server may have ideas of its own about these headers."""
    store.identities.create("ada", Role.ADMIN, 1.0)
    headers = {"x-forwarded-for": "1.2.3.4", "x-forwarded-proto": "https"}
    for settings, status in ((Settings(proxies=("127.0.0.1",)), 401), (Settings(auth="required"), 403)):
        access = access_on("127.0.0.1", settings, lambda: True)
        server = WebServer(store, open_port("127.0.0.1", 0), "127.0.0.1", access)
        server.start()
        try:
            assert httpx.post(f"{server.url}{CAMPAIGNS}", json={}, headers=headers).status_code == status
        finally:
            server.stop()
    assert [row.address for row in store.identities.audit(9).items] == ["127.0.0.1", "1.2.3.4"]


@pytest.mark.parametrize("name", ["x-forwarded-for", "Forwarded", "x-real-ip", "x-forwarded-proto"])
def test_a_proxy_in_front_is_refused(client, name):
    assert client.get(CAMPAIGNS, headers={name: "10.0.0.1"}).status_code == 403


def test_a_configured_proxy_is_believed_about_the_last_client_alone(store):
    access = access_on("127.0.0.1", Settings(proxies=("127.0.0.1",)), lambda: True)
    client = client_of(store, access)
    forwarded = {"x-forwarded-for": "1.2.3.4, 10.0.0.1, 127.0.0.1"}
    assert client.post(CAMPAIGNS, json={}, headers=forwarded).status_code == 401
    assert store.identities.audit(1).items[0].address == "10.0.0.1"
    assert client_of(store, access, peer="10.0.0.1").get("/healthz", headers=forwarded).status_code == 403


def test_a_large_body_is_refused(client):
    answer = client.post(CAMPAIGNS, content=b"x" * (600 * 1024), headers={"content-type": "application/json"})
    assert answer.status_code == 413 and answer.headers["content-type"] == "application/problem+json"


def test_a_large_body_without_a_length_is_refused(client):
    pieces = (b" " * 65536 for _ in range(10))
    answer = client.post(CAMPAIGNS, content=pieces, headers={"content-type": "application/json"})
    assert answer.status_code == 413 and answer.json()["status"] == 413


def test_a_long_address_is_refused(client):
    assert client.get(f"{CAMPAIGNS}?search={'x' * 9000}").status_code == 414


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999", "-1E+999", "9" * 400 + ".0"])
def test_a_number_that_is_not_finite_is_refused_wherever_it_stands(client, number):
    headers = {"content-type": "application/json"}
    answer = client.post(CAMPAIGNS, content=f'{{"a": [{{"b": {number}}}]}}', headers=headers)
    assert answer.status_code == 422 and answer.json()["detail"].startswith("body: expected finite numbers")


def test_words_that_look_like_numbers_are_words(client):
    fields = spec_fields(campaign={"name": "NaN 1e999", "rng_seed": 7})
    assert client.post(CAMPAIGNS, json=fields).status_code == 201


def test_deep_nesting_is_refused_and_breaks_nothing(client):
    content = b"[" * 100_000 + b"NaN"
    answer = client.post(CAMPAIGNS, content=content, headers={"content-type": "application/json"})
    assert answer.status_code in (400, 422) and answer.headers["content-type"] == "application/problem+json"


def test_every_answer_carries_the_policy(client, store, monkeypatch):
    monkeypatch.setattr(store, "problems", None)
    for path, status in (("/healthz", 200), (CAMPAIGNS, 200), ("/nothing", 404), ("/api/v1/problems", 500)):
        answer = client.get(path)
        assert (
            answer.status_code == status and "default-src 'self'" in answer.headers["content-security-policy"]
        )
        assert (
            answer.headers["x-frame-options"] == "DENY"
            and "access-control-allow-origin" not in answer.headers
        )
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "same-origin"


def test_a_bucket_gives_its_burst_at_once_and_then_its_rate():
    now = 0.0
    buckets = Buckets(2.0, 3, clock=lambda: now)
    assert [buckets.take("a") for _ in range(4)] == [0, 0, 0, 1] and buckets.take("b") == 0
    now = 1.0
    assert [buckets.take("a") for _ in range(3)] == [0, 0, 1]


def test_clients_seen_long_ago_are_forgotten():
    buckets = Buckets(1.0, 1, clock=lambda: 0.0)
    for n in range(MAX_CLIENTS + 5):
        buckets.take(str(n))
    assert len(buckets._levels) == MAX_CLIENTS


def test_too_many_requests_are_told_when_to_come_back(store):
    client = client_of(store, Access(settings=Settings(requests_per_second=0.1, request_burst=2)))
    assert [client.get(CAMPAIGNS).status_code for _ in range(3)] == [200, 200, 429]
    refused = client.get(CAMPAIGNS)
    assert 1 <= int(refused.headers["retry-after"]) <= 10
    assert refused.headers["content-type"] == "application/problem+json"


def test_streams_are_counted_and_given_back():
    streams = Streams(1)
    assert streams.enter("a") and not streams.enter("a") and streams.enter("b") and streams.n_open == 2
    streams.leave("a")
    assert streams.enter("a")


def test_streams_beyond_the_allowed_are_refused_and_ended_ones_do_not_count(store, client):
    access = Access(settings=Settings(streams_per_client=1))
    client = client_of(store, access)
    client.app.state.is_closing = lambda: True
    client.post(CAMPAIGNS, json=spec_fields())
    for _ in range(3):
        assert client.get(f"{CAMPAIGNS}/1/events").status_code == 200


def test_a_stream_too_many_is_refused(client, monkeypatch):
    client.post(CAMPAIGNS, json=spec_fields())
    monkeypatch.setattr(Streams, "enter", lambda self, name: False)
    answer = client.get(f"{CAMPAIGNS}/1/events")
    assert answer.status_code == 429 and int(answer.headers["retry-after"]) > 0


def test_a_path_whose_verb_is_another_is_told_which_it_has(client):
    answer = client.delete(CAMPAIGNS)
    assert answer.status_code == 405 and answer.headers["allow"] == "GET, POST"
