"""A job is its claimant's: no other token extends it, asks about it, or ends it."""

import httpx
import pytest
from fastapi.testclient import TestClient

from service.app import create_app
from service.auth.network import Access
from service.schemas.identity import Role
from tests.service.by_hand import worker_info
from tests.service.campaigns import submitted
from tests.service.databases import rows
from tests.workers.fake import run_fake
from workers.client import Api, HttpSource
from workers.messages import (
    ClaimRequest,
    CompleteManyRequest,
    CompleteRequest,
    Ended,
    Ending,
    Finished,
    HeartbeatRequest,
    HeldJob,
    HopJob,
    Sealed,
    StaleAttemptError,
    Ticket,
)

JOBS = "/api/v1/jobs"
INFO = worker_info()
JSON = {"Content-Type": "application/json"}


@pytest.fixture
def client(store):
    submitted(store)
    app = create_app(store, access=Access(is_open=False))
    with TestClient(app, base_url="http://127.0.0.1:8741", raise_server_exceptions=False) as opened:
        yield opened


@pytest.fixture
def post(store, client):
    """Return a function that posts as the token of a name, made when it is asked for first."""
    tokens = {}

    def ask(name, path, body, role="worker"):
        if name not in tokens:
            tokens[name] = store.identities.create(name, Role(role), 1.0).token
        headers = JSON | {"Authorization": f"Bearer {tokens[name]}"}
        return client.post(f"{JOBS}/{path}", content=body.model_dump_json(), headers=headers)

    ask.tokens = tokens
    return ask


def claimed(post, name="ann", n=1):
    answer = post(name, "claim", ClaimRequest(worker=INFO, n_jobs=n))
    return answer.json()["claims"]


def report_on(claim):
    outcome = run_fake(HopJob.model_validate(claim["job"]))
    return CompleteRequest(job_id=claim["job_id"], attempt=claim["attempt"], outcome=outcome)


def heartbeat(claim, extend=True):
    held = HeldJob(job_id=claim["job_id"], attempt=claim["attempt"])
    return HeartbeatRequest(worker=INFO, held=(held,), extend=extend)


def lease(store):
    return rows(store, "SELECT max(lease_until) FROM job")


@pytest.mark.parametrize(("other", "role"), [("bob", "worker"), ("root", "admin")])
def test_another_token_neither_ends_nor_extends_a_job(store, post, other, role):
    (claim,) = claimed(post)
    before = lease(store)
    report = report_on(claim)
    for path, body in (("complete", report), ("complete-many", CompleteManyRequest(reports=(report,)))):
        answer = post(other, path, body, role)
        assert answer.status_code == 403 and answer.json()["code"] == "other_claimant"
        assert "expected the token that claimed attempt 1" in answer.json()["detail"]
    for extend in (True, False):
        answer = post(other, "heartbeat", heartbeat(claim, extend), role).json()
        assert answer["not_held"] == [{"job_id": claim["job_id"], "attempt": 1}]
        assert answer["extended"] == answer["to_cancel"] == []
    assert lease(store) == before and rows(store, "SELECT count(*) FROM solve") == [(0,)]
    assert post("ann", "heartbeat", heartbeat(claim)).json()["extended"]
    assert not post("ann", "heartbeat", heartbeat(claim, extend=False)).json()["not_held"]
    assert post("ann", "complete", report).json()["state"] == "done"
    # Nor is another told what became of it.
    assert post(other, "complete", report, role).json()["code"] == "other_claimant"
    assert post("ann", "complete", report).json()["state"] == "done"


def test_a_token_in_place_of_another_hands_in_what_that_one_claimed(store, post):
    (claim,) = claimed(post)
    post.tokens["ann"] = store.identities.replace("ann", Role.WORKER, 1.0).token
    assert post("ann", "heartbeat", heartbeat(claim)).json()["extended"]
    assert post("ann", "complete", report_on(claim)).json()["state"] == "done"


def test_what_was_claimed_without_a_token_anybody_may_hand_in(store, post):
    (claim,) = store.claim(INFO, 1)
    report = CompleteRequest(job_id=claim.job_id, attempt=claim.attempt, outcome=run_fake(claim.job))
    assert post("bob", "complete", report).json()["state"] == "done"


def test_one_report_of_another_among_several_costs_none_of_them(store, post):
    (mine,), (other,) = claimed(post, "ann"), claimed(post, "bob")
    reports = (report_on(mine), report_on(other))
    answer = post("ann", "complete-many", CompleteManyRequest(reports=reports))
    assert answer.status_code == 403 and rows(store, "SELECT count(*) FROM solve") == [(0,)]
    assert post("ann", "complete", reports[0]).status_code == 200
    assert post("bob", "complete", reports[1]).status_code == 200


def test_a_worker_counts_it_as_no_longer_its_own():
    fault = {"status": 403, "detail": "job 1: expected the token that claimed", "code": "other_claimant"}
    answer = httpx.MockTransport(lambda request: httpx.Response(403, json=fault))
    with Api("http://127.0.0.1:8741", "bob", transport=answer) as api, pytest.raises(StaleAttemptError):
        HttpSource(api).complete(Finished(Ticket(1, 1), Sealed(Ended(ending=Ending.CRASH))))


def test_where_no_token_is_asked_for_the_machine_is_one_claimant(store):
    submitted(store)
    with TestClient(create_app(store), base_url="http://127.0.0.1:8741") as open_client:
        body = ClaimRequest(worker=INFO, n_jobs=1).model_dump_json()
        (claim,) = open_client.post(f"{JOBS}/claim", content=body, headers=JSON).json()["claims"]
        assert rows(store, "SELECT claimed_by FROM attempt") == [("loopback",)]
        report = report_on(claim).model_dump_json()
        answer = open_client.post(f"{JOBS}/complete", content=report, headers=JSON)
        assert answer.json()["state"] == "done"
