"""Workers, operators and seed queries over HTTP: the body and the row."""

import json
import platform
from typing import get_args

import pytest

from service.spec.search_spec import SeedOrder
from tests.service.campaigns import OUTAGE, spec_fields, submitted
from tests.workers.fake import run_fake
from workers.messages import ClaimAnswer, CompleteAnswer, HeartbeatAnswer, JobOutcome
from workers.provenance import code_version

API = "/api/v1"
WORKER = {
    "name": "node7:1",
    "host": "node7",
    "executor": "process",
    "slots": 4,
    "code_version": code_version(),
    "python_version": platform.python_version(),
}


def claimed(client, n_jobs=1):
    answer = client.post(f"{API}/jobs/claim", json={"worker": WORKER, "n_jobs": n_jobs})
    assert answer.status_code == 200
    return ClaimAnswer.model_validate(answer.json())


def reported(client, claim, outcome):
    body = {"job_id": claim.job_id, "attempt": claim.attempt, "outcome": outcome.model_dump(mode="json")}
    return client.post(f"{API}/jobs/complete", json=body)


def work(store, n_jobs=1000):
    for _ in range(n_jobs):
        for claim in store.claim("a", 1):
            store.complete(claim.ticket, run_fake(claim.job))


def test_a_worker_claims_keeps_and_returns_jobs_over_http(client, store):
    submitted(store)
    answer = claimed(client, 2)
    assert len(answer.claims) == 2 and (answer.lease_s, answer.heartbeat_s) == (30.0, 10.0)
    held = [{"job_id": claim.job_id, "attempt": claim.attempt} for claim in answer.claims]
    beat = client.post(f"{API}/jobs/heartbeat", json={"worker": WORKER, "held": held}).json()
    assert len(HeartbeatAnswer.model_validate(beat).extended) == 2
    other = {"job_id": 999, "attempt": 1}
    asked = {"worker": WORKER, "held": [*held, other], "extend": False}
    look = client.post(f"{API}/jobs/heartbeat", json=asked).json()
    assert look == {"extended": [], "to_cancel": [], "not_held": [other]}
    (worker,) = client.get(f"{API}/workers").json()["items"]
    assert worker["is_alive"] and [job["job_id"] for job in worker["held"]] == [1, 2]
    claim = answer.claims[0]
    done = reported(client, claim, run_fake(claim.job))
    assert CompleteAnswer.model_validate(done.json()).state == "done"
    assert reported(client, claim, run_fake(claim.job)).json() == done.json()
    assert store.job(claim.job_id).state == "done"


def test_a_vector_crosses_http_bit_by_bit(client, store):
    submitted(store)
    (claim,) = claimed(client).claims
    while claim.job.kind == "hop":
        reported(client, claim, run_fake(claim.job))
        (claim,) = claimed(client).claims
    record = store.record(claim.job.seed_id)
    assert [x.hex() for x in claim.job.seed_x] == [x.hex() for x in record.x]


def test_a_stale_report_is_a_409_with_its_code(client, store):
    submitted(store)
    (claim,) = claimed(client).claims
    store.recover()
    # Until somebody claims the job again its result is taken.
    assert claimed(client).claims
    answer = reported(client, claim, run_fake(claim.job))
    assert answer.status_code == 409 and answer.json()["code"] == "stale_attempt"
    assert answer.headers["content-type"] == "application/problem+json"
    assert store.campaign(1).n_solves == 0


def test_a_worker_of_another_version_is_a_409_with_the_remedy(client, store):
    submitted(store)
    for call in ("claim", "heartbeat"):
        body = {"worker": WORKER | {"code_version": "0"}} | ({"n_jobs": 1} if call == "claim" else {})
        answer = client.post(f"{API}/jobs/{call}", json=body)
        assert answer.status_code == 409 and answer.json()["code"] == "worker_refused"
        assert "install the coordinator's version" in answer.json()["detail"]
    assert store.workers().items == []


@pytest.mark.parametrize(
    "change",
    [
        {"job_id": 0},
        {"attempt": 2**63},
        {"outcome": {"ending": "asleep"}},
        {"outcome": {"ending": "error", "error": "\ud800"}},
        {"outcome": {"ending": "feasible", "solves": [{"hop": 0}]}},
    ],
)
def test_a_report_that_cannot_be_is_a_422(client, change):
    body = {"job_id": 1, "attempt": 1, "outcome": JobOutcome(ending="crash").model_dump(mode="json")}
    # Escaped, as a lone surrogate can only be sent.
    content = json.dumps(body | change)
    answer = client.post(
        f"{API}/jobs/complete", content=content, headers={"content-type": "application/json"}
    )
    assert answer.status_code == 422 and answer.json()["detail"]


def test_operators_pause_resume_and_cancel(client, store):
    submitted(store)
    place = f"{API}/campaigns/1"
    assert client.post(f"{place}/pause").json()["state"] == "paused" and claimed(client).claims == ()
    assert client.post(f"{place}/resume").json()["state"] == "active"
    body = client.post(f"{place}/searches/s0/pause").json()
    assert body["searches"][0]["state"] == "paused" and claimed(client).claims == ()
    assert client.post(f"{place}/searches/s0/resume").json()["searches"][0]["state"] == "active"
    assert client.post(f"{place}/searches/s0/cancel").json()["searches"][0]["state"] == "cancelled"
    again = client.post(f"{place}/searches/s0/resume")
    assert again.status_code == 409 and again.json()["code"] == "wrong_state"
    assert "search s0: expected state paused to resume, got cancelled" in again.json()["detail"]
    assert client.post(f"{API}/campaigns/9/pause").status_code == 404


def test_operators_share_and_order(client, store):
    submitted(store)
    place = f"{API}/campaigns/1"
    body = client.post(f"{place}/searches/s0/weight", json={"weight": 2.5}).json()
    assert body["searches"][0]["weight"] == 2.5
    body = client.post(f"{place}/searches/s0/priority", json={"priority": -7}).json()
    assert body["searches"][0]["priority"] == -7
    assert client.post(f"{place}/priority", json={"priority": 3}).json()["priority"] == 3
    for weight in (0, -1, "NaN", 1e9):
        assert client.post(f"{place}/searches/s0/weight", json={"weight": weight}).status_code == 422


def test_operators_cancel_and_requeue_jobs(client, store):
    submitted(store)
    assert client.post(f"{API}/jobs/1/cancel").json()["state"] == "cancelled"
    assert client.post(f"{API}/jobs/1/requeue").json()["state"] == "queued"
    (claim,) = claimed(client).claims
    assert client.post(f"{API}/jobs/{claim.job_id}/cancel").json()["is_cancelling"]
    answer = client.post(f"{API}/jobs/{claim.job_id}/requeue")
    assert answer.status_code == 409 and "expected state dead or cancelled" in answer.json()["detail"]
    assert client.get(f"{API}/jobs/1").json()["state"] == store.job(1).state
    assert client.get(f"{API}/jobs/999").status_code == 404


def test_a_key_makes_a_repeated_submission_known_and_another_one_refused(client, store):
    headers = {"Idempotency-Key": "abc-1"}
    statuses = [
        client.post(f"{API}/campaigns", json=fields, headers=headers).status_code
        for fields in (spec_fields(), spec_fields(), spec_fields(guesses=9))
    ]
    assert statuses == [201, 200, 409] and len(store.campaigns()) == 1
    bad = client.post(f"{API}/campaigns", json=spec_fields(), headers={"Idempotency-Key": "a b"})
    assert bad.status_code == 422


@pytest.fixture
def seeded(store):
    submitted(store)
    work(store, 12)
    return store


def seeds(client, **query):
    answer = client.get(f"{API}/seeds", params=query)
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_seeds_of_a_search_are_those_that_it_has_planned(client, seeded):
    page = seeds(client, campaign=1, search="s1-0")
    s0 = seeded.campaign(1).searches[0]
    assert page["n_candidates"] == len(page["items"]) == s0.n_strict > 0 and not page["is_cut"]
    assert all(item["job_id"] and item["job_state"] == "done" for item in page["items"])
    (item, *_) = seeds(client, campaign=1, search="s1-0", order="delta_v", limit=1)["items"]
    assert item["delta_v_km_s"] == s0.best_delta_v_km_s and item["mapping"] == "reference"
    assert item["outages"] == [OUTAGE] and item["seed_outages"] == []


@pytest.mark.parametrize("order", get_args(SeedOrder))
def test_seeds_come_in_every_order_that_a_search_may_ask_for(client, seeded, order):
    asked = {"campaign": 1, "search": "s1-0", "order": order}
    assert len(seeds(client, **asked)["items"]) == seeds(client, **asked)["n_candidates"] > 0


def test_seeds_of_a_problem_come_from_the_whole_archive(client, seeded):
    p0, p1 = (problem.hash for problem in seeded.problems().items)
    same = seeds(client, problem=p1, k=0)
    assert {i["seed_id"] for i in same["items"]} == {
        i["seed_id"] for i in seeds(client, campaign=1, search="s1-0")["items"]
    }
    two = seeds(client, problem=p0, outage=["24:1.0", "40:1.0"], mapping="reference", order="delta_v")
    assert {len(item["seed_outages"]) for item in two["items"]} == {0, 1}
    best = [item["delta_v_km_s"] for item in two["items"]]
    assert best == sorted(best) and {item["job_id"] for item in two["items"]} == {None}
    assert all(len(item["outages"]) == 2 for item in two["items"])


@pytest.mark.parametrize(
    ("query", "status"),
    [
        ({}, 422),
        ({"campaign": 1}, 422),
        ({"campaign": 1, "search": "s0"}, 422),
        ({"campaign": 1, "search": "s9"}, 404),
        ({"campaign": 9, "search": "s0"}, 404),
        ({"problem": "0" * 32}, 404),
        ({"campaign": 1, "search": "s1-0", "mapping": "sideways"}, 422),
        ({"campaign": 1, "search": "s1-0", "order": "luck"}, 422),
        ({"problem": "0" * 32, "outage": "24"}, 422),
    ],
)
def test_a_seed_query_that_makes_no_sense_is_refused(client, store, query, status):
    submitted(store)
    answer = client.get(f"{API}/seeds", params=query)
    assert answer.status_code == status and answer.json()["detail"]


def test_seeds_of_a_problem_without_outages_or_with_impossible_ones_are_refused(client, seeded):
    p0 = seeded.problems().items[0].hash
    for query in ({}, {"outage": "9999:1.0"}, {"outage": ["24:1.0", "24:1.0"]}, {"outage": "24:1.0", "k": 7}):
        assert client.get(f"{API}/seeds", params={"problem": p0} | query).status_code == 422
