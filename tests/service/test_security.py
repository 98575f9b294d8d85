import pytest

from service.security import BindError, require_loopback
from tests.service.campaigns import spec_fields

CAMPAIGNS = "/api/v1/campaigns"


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.2", "::1", "localhost"])
def test_this_machine_may_be_bound(host):
    assert require_loopback(host) == host


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.5", "example.org", ""])
def test_another_address_is_refused_with_a_remedy(host):
    with pytest.raises(BindError, match=r"expected a loopback address .* forward a port over ssh"):
        require_loopback(host)


@pytest.mark.parametrize("host", ["127.0.0.1:8741", "localhost", "LOCALHOST:1", "[::1]:8741"])
def test_our_own_names_are_answered(client, host):
    assert client.get(CAMPAIGNS, headers={"host": host}).status_code == 200


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example", "[::2]", "evil.example:127.0.0.1", ""]
)
def test_another_name_is_refused_even_for_reading(client, host):
    answer = client.get(CAMPAIGNS, headers={"host": host})
    assert answer.status_code == 403 and answer.headers["content-type"] == "application/problem+json"


def test_a_form_of_another_site_is_refused_and_ours_is_not(client):
    url, fields = CAMPAIGNS, spec_fields()
    foreign = client.post(url, json=fields, headers={"origin": "https://evil.example"})
    assert foreign.status_code == 403 and "Origin" in foreign.json()["detail"]
    own = client.post(url, json=fields, headers={"origin": "http://127.0.0.1:8741"})
    assert own.status_code == 201


def test_a_proxy_in_front_is_refused(client):
    assert client.get(CAMPAIGNS, headers={"x-forwarded-for": "10.0.0.1"}).status_code == 403


def test_a_large_body_is_refused(client):
    answer = client.post(CAMPAIGNS, content=b"x" * (600 * 1024), headers={"content-type": "application/json"})
    assert answer.status_code == 413 and answer.headers["content-type"] == "application/problem+json"


def test_a_large_body_without_a_length_is_refused(client):
    pieces = (b" " * 65536 for _ in range(10))
    answer = client.post(CAMPAIGNS, content=pieces, headers={"content-type": "application/json"})
    assert answer.status_code == 413


def test_every_answer_carries_the_policy(client):
    for path in ("/healthz", CAMPAIGNS, "/nothing"):
        headers = client.get(path).headers
        assert "default-src 'self'" in headers["content-security-policy"]
        assert headers["x-frame-options"] == "DENY" and headers["x-content-type-options"] == "nosniff"
