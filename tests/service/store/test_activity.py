"""One search hop by hop, attempts by time, the queue: what two pages of the dashboard look at."""

from datetime import UTC, datetime

import numpy as np
import pytest
from fastapi.testclient import TestClient

from core.search import Chain, HopSettings
from service.app import create_app
from service.spec import spec_from
from service.store.jobs import Activity
from service.store.searches import widths
from service.store.store import Store
from tests.core.search.test_hopping import SMALL, outcome
from tests.service.by_hand import work_off, worker_info
from tests.service.campaigns import OUTAGE, spec_fields, submitted
from tests.service.clock import Clock
from tests.service.databases import needs_postgres
from tests.workers.fake import record, run_fake
from workers.messages import Ending, JobOutcome

BOTH = pytest.mark.parametrize(
    "store", ["sqlite", pytest.param("postgresql", marks=needs_postgres)], indirect=True
)
ERROR = JobOutcome(ending=Ending.ERROR, error="Traceback ...\nZeroDivisionError: oh")
URL = "/api/v1/campaigns/1/searches"


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def timed(tmp_path, clock):
    """A store whose time the test tells, and its API."""
    with (
        Store(tmp_path, clock=clock) as store,
        TestClient(create_app(store), base_url="http://127.0.0.1:8741") as client,
    ):
        yield store, client


@pytest.mark.parametrize("law", ["uniform", "pareto"])
def test_widths_told_from_moves_are_those_that_the_chain_had(law):
    settings = HopSettings(hop_law=law, adaptive=True, max_failures=3)
    chain, told, had = Chain(SMALL, settings), [], []
    for violation in (np.inf, 9.0, 8.0, 8.5, 7.0, 7.5, 7.5, 7.5, 9.0, 8.0, 8.0, 6.0):
        had.append(chain.width if chain.is_hopping else None)
        move = chain.tell(outcome(violation, 0.0))
        told.append((move, violation if np.isfinite(violation) else None))
    assert "restarted" in {move for move, _ in told} and had.count(None) == 3
    assert widths(settings, told) == had


@BOTH
def test_a_search_of_chains_says_its_laws_with_what_they_have_by_themselves(store):
    fields = spec_fields()
    fields["search"][0] |= {"hop_law": "cauchy", "adaptive": True}
    submitted(store, fields)
    work_off(store)
    found = store.activity.search(1, "s0")
    assert (found.laws.width, found.laws.width_range, found.laws.shape) == (1e-3, (1e-4, 0.5), None)
    assert found.seeds is None and found.n_solves == found.n_guesses_planned == 8
    assert found.best_delta_v_km_s is not None and found.n_strict <= found.n_paper < 8


@BOTH
def test_hops_come_chain_by_chain_with_the_seeds_of_mapped_ones(store):
    submitted(store)
    work_off(store)
    drawn = store.activity.hops(1, "s0").solves
    assert list(zip(drawn.chain, drawn.hop, strict=True)) == [(c, h) for c in range(4) for h in range(2)]
    assert drawn.width[::2] == [None] * 4
    mapped = store.activity.hops(1, "s1-0")
    assert [seed.search for seed in mapped.seeds] == ["s0"] * len(mapped.seeds)
    strict = [s for s, verdict in zip(drawn.solution_id, drawn.verdict, strict=True) if verdict == "strict"]
    assert sorted(seed.id for seed in mapped.seeds) == sorted(strict)
    assert set(mapped.solves.mapping) == {"reference"} and set(mapped.solves.move) == {None}
    assert mapped.solves.chain == list(range(len(mapped.seeds)))


@BOTH
def test_more_solves_than_asked_for_are_whole_chains_drawn_evenly(store):
    submitted(store, spec_fields(guesses=400))
    work_off(store)
    view = store.activity.hops(1, "s0", limit=40)
    assert (view.n_shown, view.n_all) == (40, 400)
    assert view.solves.hop == [0, 1] * 20
    # Drawn from 200 chains: no gap is three times as wide as even ones would be.
    assert np.diff([-1, *view.solves.chain[::2], 200]).max() < 30
    assert store.activity.hops(1, "s0", limit=40) == view
    mapped = store.activity.hops(1, "s1-0", limit=40)
    assert 10 < mapped.n_shown <= 40 < mapped.n_all and mapped.solves.chain == list(range(len(mapped.seeds)))


def test_after_an_answer_come_the_chains_that_have_grown_since(store, client):
    submitted(store)
    first, second, *_ = store.claim(worker_info(), 4)
    store.complete(first.ticket, run_fake(first.job))
    answer = client.get(f"{URL}/s0/hops").json()
    assert answer["n_shown"] == answer["n_all"] == 2
    store.complete(second.ticket, run_fake(second.job))
    later = client.get(f"{URL}/s0/hops", params={"after": answer["last"]}).json()
    assert (later["n_shown"], later["n_all"]) == (2, 4)
    assert set(later["solves"]["chain"]) == {second.job.address.chain}
    assert client.get(f"{URL}/s0/hops", params={"after": later["last"]}).json()["n_shown"] == 0


def test_a_chain_that_lacks_its_first_hops_has_no_widths(store):
    submitted(store)
    (claim,) = store.claim(worker_info(), 1)
    last = record(claim.job, 1)
    outcome_ = JobOutcome(ending=Ending.ERROR, solves=(last,), provenance=run_fake(claim.job).provenance)
    store.complete(claim.ticket, outcome_)
    assert store.activity.hops(1, "s0").solves.width == [None]


def test_a_search_that_is_not_there_is_told(store, client):
    submitted(store)
    for path in ("/nobody", "/nobody/hops"):
        answer = client.get(URL + path)
        assert answer.status_code == 404 and "search nobody of campaign 1" in answer.json()["detail"]


@BOTH
def test_attempts_of_a_window_are_those_that_ran_in_it(store):
    clock = Clock(now=1000.0)
    store._clock, store._is_clock_shared = clock, False
    activity = store.activity = Activity(store._database, clock, store.leases)
    submitted(store)
    for begin, end in ((1000.0, 1060.0), (1100.0, 1200.0), (1150.0, None)):
        clock.now = begin
        (claim,) = store.claim(worker_info(), 1)
        if end is not None:
            clock.now = end
            store.complete(claim.ticket, run_fake(claim.job))

    def begun(since, until):
        return [item.started_at.timestamp() for item in activity.attempts(since, until).items]

    assert begun(None, None) == [1000.0, 1100.0, 1150.0]
    assert begun(1061.0, 1140.0) == [1100.0]
    assert begun(1061.0, 1300.0) == [1100.0, 1150.0]
    assert begun(0.0, 1060.0) == [1000.0]
    last = activity.attempts(1061.0, None).items[-1]
    assert last.ended_at is None and (last.search, last.strategy, last.kind) == ("s0", "S(0)", "hop")


def test_more_attempts_than_asked_for_are_drawn_evenly_and_those_that_run_are_kept(timed, clock):
    store, client = timed
    submitted(store, spec_fields(guesses=400))
    for claim in store.claim(worker_info(), 150):
        clock.now += 1.0
        store.complete(claim.ticket, run_fake(claim.job))
    running = {claim.job_id for claim in store.claim(worker_info(), 5)}
    answer = client.get("/api/v1/attempts", params={"limit": 50}).json()
    assert answer["n_all"] == 155 and 40 < len(answer["items"]) <= 50
    assert {item["job_id"] for item in answer["items"] if item["ended_at"] is None} == running
    ended = [datetime.fromisoformat(i["ended_at"]).timestamp() for i in answer["items"] if i["ended_at"]]
    assert np.diff(sorted(ended)).max() < 10.0


def test_a_window_that_ends_before_it_begins_is_refused(client):
    answer = client.get("/api/v1/attempts", params={"since": "2026-01-02", "until": "2026-01-01T00:00:00Z"})
    assert answer.status_code == 422 and "expected a moment before until" in answer.json()["detail"]


def test_the_attempts_at_a_job_tell_its_errors_in_full(store, client):
    submitted(store)
    (claim,) = store.claim(worker_info(), 1)
    store.complete(claim.ticket, ERROR)
    (attempt,) = client.get(f"/api/v1/jobs/{claim.job_id}/attempts").json()["items"]
    assert attempt["error"] == ERROR.error and attempt["ending"] == "error"
    (job,) = client.get("/api/v1/jobs", params={"state": "dead"}).json()["items"]
    assert job["error"] == "ZeroDivisionError: oh" and job["search"] == "s0"
    assert client.get("/api/v1/jobs/999/attempts").status_code == 404


@BOTH
def test_the_queue_counts_by_campaign_and_knows_who_waits_longest(store):
    submitted(store)
    other = spec_fields() | {"campaign": {"name": "other", "rng_seed": 8}}
    submitted(store, other)
    claim, *_ = store.claim(worker_info(), 1)
    store.complete(claim.ticket, ERROR)
    queue = store.activity.queue()
    assert (queue.jobs.queued, queue.jobs.dead) == (7, 1)
    assert [(item.name, item.jobs.dead) for item in queue.campaigns] == [("other", 0), ("test", 1)]
    assert queue.oldest_job_id == 2 and queue.oldest_queued_at < queue.at.astimezone(UTC)


def test_all_dead_jobs_of_a_campaign_are_put_back_at_once(store, client):
    submitted(store)
    for claim in store.claim(worker_info(), 3):
        store.complete(claim.ticket, ERROR)
    assert client.post("/api/v1/campaigns/1/requeue").json() == {"n_jobs": 3}
    assert store.activity.queue().jobs.dead == 0
    assert store.events(0, 1)[-1].data == {"state": "active", "n_requeued": 3}
    assert client.post("/api/v1/campaigns/1/requeue").json() == {"n_jobs": 0}
    assert client.post("/api/v1/campaigns/9/requeue").status_code == 404


def test_a_worker_shows_what_it_measured(store, client):
    submitted(store)
    need = {"cpu_cores": 1.5, "memory_bytes": 10**9, "host_memory_bytes": 10**10}
    store.claim(worker_info().model_copy(update=need), 1)
    (worker,) = client.get("/api/v1/workers").json()["items"]
    assert need.items() <= worker.items()


def test_seeds_of_another_campaign_are_named_with_it(store):
    submitted(store)
    work_off(store)
    more = {"id": "again", "strategy": "S(1|0)", "outages": [OUTAGE | {"segment": 30}]}
    fields = {
        "campaign": {"name": "later", "rng_seed": 9},
        "problem": {"preset": "ppe-drm3"},
        "search": [more | {"seeds": {"from": "s0", "campaign": "test", "limit": 2}}],
    }
    store.submit(spec_from(fields))
    found = store.activity.search(2, "again")
    assert (found.seeds.source, found.seeds.campaign, found.seeds.limit) == ("s0", "test", 2)
    assert found.laws is None
