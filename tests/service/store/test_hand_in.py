"""Hops that a chain hands in as it goes: stored at once, and the next attempt begins after them."""

import os
import signal

import psutil
import pytest
from sqlalchemy import text

from service.coordinator import Coordinator, WorkerSetup
from service.integrity.check import check
from service.scheduler import LeaseSettings
from service.store.errors import StoreError
from service.store.store import Store
from tests.service.campaigns import content, dispatcher_pid, finish, spec_fields, submitted
from tests.service.clock import Clock
from tests.service.coordinator.test_dispatch import wait_for
from tests.service.databases import rows
from tests.workers.fake import run_fake
from workers.dispatch import ExecutorKind
from workers.messages import (
    ChainPart,
    ChainPlace,
    CompleteRequest,
    Ending,
    HandInRequest,
    JobOutcome,
    StaleAttemptError,
)

N_HOPS = 10
HANDING_IN = "tests.workers.fake:run_handing_in"


def fields(n_chains=2):
    made = spec_fields(n_chains * N_HOPS)
    made["search"][0]["hops"] = N_HOPS
    return made


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def store(tmp_path, clock):
    with Store(tmp_path, clock=clock) as opened:
        submitted(opened, fields())
        yield opened


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    with Store(tmp_path_factory.mktemp("undisturbed")) as opened:
        submitted(opened, fields())
        finish(opened)
        return content(opened)


def handed_in(claim, part):
    return HandInRequest(**claim.ticket._asdict(), part=part)


def part_of(claim, first, stop, next_hop=None, **more):
    outcome = run_fake(claim.job)
    place = {"next_hop": next_hop or stop, "ending": "feasible", "failures": 1, "width": 0.1}
    place = ChainPlace(**place | {"has_incumbent": False} | more)
    return ChainPart(solves=outcome.solves[first:stop], provenance=outcome.provenance, place=place)


def claim_again(store, clock, claim):
    """Lose an attempt, and return the next at the same job."""
    clock.advance(31.0)
    assert store.reap() == 1
    clock.advance(61.0)
    return next_claim(store, claim)


def next_claim(store, claim):
    """Return the next attempt at a job, after doing what others get before it."""
    while True:
        (again,) = store.claim("b", 1)
        if again.job_id == claim.job_id:
            return again
        store.complete(again.ticket, run_fake(again.job))


def hops(store):
    return [hop for (hop,) in rows(store, "SELECT hop FROM solve WHERE job_id = 1 ORDER BY hop")]


def test_hops_are_stored_when_they_are_handed_in_and_the_next_attempt_begins_after_them(
    store, clock, expected
):
    claim = store.claim("a", 1)[0]
    assert claim.job.place is None
    assert store.hand_in(handed_in(claim, part_of(claim, 0, 3))).next_hop == 3
    assert hops(store) == [0, 1, 2] and store.campaign(1).n_solves == 3
    assert store.hand_in(handed_in(claim, part_of(claim, 3, 5))).next_hop == 5
    again = claim_again(store, clock, claim)
    assert again.job.place.next_hop == 5 and again.job.place.failures == 1
    rest = run_fake(again.job)
    store.complete(again.ticket, rest.model_copy(update={"solves": rest.solves[5:]}))
    finish(store)
    assert content(store) == expected
    assert {one.state for one in check(store._database.place)} == {"ok"}
    assert rows(store, "SELECT count(*) FROM job WHERE place IS NOT NULL") == [(0,)]
    attempts = rows(store, "SELECT hop, attempt FROM solve WHERE job_id = 1 ORDER BY hop")
    assert attempts == [(hop, 1 if hop < 5 else 2) for hop in range(N_HOPS)]


def test_a_part_that_comes_twice_or_late_changes_nothing(store, clock):
    claim = store.claim("a", 1)[0]
    for first, stop in ((0, 2), (2, 4), (0, 2), (2, 4)):
        store.hand_in(handed_in(claim, part_of(claim, first, stop)))
    before = (
        rows(store, "SELECT * FROM solve"),
        rows(store, "SELECT * FROM tally"),
        store.campaign(1).n_solves,
    )
    assert store.hand_in(handed_in(claim, part_of(claim, 0, 2))).next_hop == 4
    after = rows(store, "SELECT * FROM solve"), rows(store, "SELECT * FROM tally"), store.campaign(1).n_solves
    assert before == after and hops(store) == [0, 1, 2, 3]
    assert claim_again(store, clock, claim).job.place.next_hop == 4


def test_a_part_of_an_attempt_that_lost_its_job_is_stale(store, clock):
    claim = store.claim("a", 1)[0]
    again = claim_again(store, clock, claim)
    with pytest.raises(StaleAttemptError):
        store.hand_in(handed_in(claim, part_of(claim, 0, 3)))
    assert hops(store) == []
    assert store.hand_in(handed_in(again, part_of(again, 0, 3))).next_hop == 3


@pytest.mark.parametrize(
    ("first", "stop", "more", "reason"),
    [
        (0, 3, {"next_hop": 4}, "expected all 4 hops before 4, got 3"),
        (1, 3, {}, "expected all 3 hops before 3, got 2"),
        (0, 3, {"next_hop": N_HOPS}, f"expected a hop within its chain, got {N_HOPS}"),
        (0, 3, {"next_hop": 10**6}, "expected a hop within its chain, got 1000000"),
        (0, 3, {"has_incumbent": True, "x": [1.0]}, "expected 154 numbers in x, got 1"),
    ],
)
def test_a_place_that_a_chain_cannot_have_is_refused_and_nothing_is_stored(store, first, stop, more, reason):
    claim = store.claim("a", 1)[0]
    with pytest.raises(StoreError, match=reason):
        store.hand_in(handed_in(claim, part_of(claim, first, stop, **more)))
    assert hops(store) == []


def test_losses_in_a_row_count_and_hops_in_between_forgive_them(store, clock):
    claim = store.claim("a", 1)[0]
    for n_done in range(1, 8):
        store.hand_in(handed_in(claim, part_of(claim, n_done - 1, n_done)))
        claim = claim_again(store, clock, claim)
        assert rows(store, "SELECT n_failures FROM job WHERE id = 1") == [(1,)]
    assert claim.job.place.next_hop == 7


def test_a_chain_begins_anew_where_a_hop_was_set_aside_since(store, clock):
    claim = store.claim("a", 1)[0]
    store.hand_in(handed_in(claim, part_of(claim, 0, 4)))
    store._database.write(
        lambda session: session.execute(text("DELETE FROM solve WHERE job_id = 1 AND hop = 2"))
    )
    again = claim_again(store, clock, claim)
    assert again.job.place is None
    assert store.complete(again.ticket, run_fake(again.job)).state == "done" and hops(store) == list(
        range(N_HOPS)
    )


def test_a_chain_that_is_stopped_goes_on_where_it_stood(store):
    claim = store.claim("a", 1)[0]
    part = part_of(claim, 0, 4)
    outcome = {"ending": Ending.CANCELLED, "solves": part.solves, "provenance": part.provenance}
    assert store.complete(claim.ticket, JobOutcome(**outcome, place=part.place)).state == "queued"
    assert next_claim(store, claim).job.place == part.place


def test_parts_come_by_http_like_every_report(store, client):
    claim = store.claim("a", 1)[0]
    request = HandInRequest(job_id=claim.job_id, attempt=claim.attempt, part=part_of(claim, 0, 2))
    answer = client.post("/api/v1/jobs/hand-in", json=request.model_dump(mode="json"))
    assert answer.status_code == 200 and answer.json() == {"job_id": 1, "attempt": 1, "next_hop": 2}
    late = request.model_copy(update={"attempt": 9}).model_dump(mode="json")
    answer = client.post("/api/v1/jobs/hand-in", json=late)
    assert answer.status_code == 409 and answer.json()["code"] == "stale_attempt"
    report = CompleteRequest(job_id=1, attempt=1, outcome=run_fake(claim.job))
    answer = client.post("/api/v1/jobs/complete", json=report.model_dump(mode="json"))
    assert answer.json()["state"] == "done" and hops(store) == list(range(N_HOPS))


def test_a_killed_worker_costs_a_hop_and_not_its_chain(tmp_path, expected):
    with Coordinator(tmp_path, leases=LeaseSettings(lease_s=60.0)) as running:
        campaign = submitted(running.store, fields())
        running.work(WorkerSetup(2, ExecutorKind.PROCESS, HANDING_IN), campaign)
        wait_for(lambda: 3 <= running.store.campaign(campaign).n_solves)
        for child in psutil.Process(dispatcher_pid(running)).children():
            os.kill(child.pid, signal.SIGKILL)
        wait_for(lambda: running.store.campaign(campaign).state == "done")
        assert content(running.store) == expected
        first = "SELECT job_id, min(hop), max(attempt) FROM solve WHERE attempt = 2 GROUP BY job_id"
        begun_again = rows(running.store, first)
        # Both chains went on with a later hop than their first, and nothing was solved twice.
        assert begun_again and all(hop >= 1 for _, hop, _ in begun_again)
