"""Results that come late, from elsewhere, or after their report was refused."""

import pytest

from service.store import Store, StoreError
from service.store.dispatch import Report
from tests.service.campaigns import submitted
from tests.service.clock import Clock
from tests.service.databases import rows
from tests.workers.fake import run_fake
from workers.dispatcher import StaleAttempt
from workers.executor import Ticket
from workers.job import Ending, JobOutcome, job_digest


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def store(tmp_path, clock):
    with Store(tmp_path, clock=clock) as opened:
        yield opened


def ticket(claim):
    return Ticket(claim.job_id, claim.attempt)


def claim_one(store, worker="a"):
    (claim,) = store.claim(worker, 1)
    return claim


@pytest.mark.parametrize("loss", ["lease", "restart"])
def test_a_result_that_comes_when_its_job_waits_again_is_taken_and_saves_the_work(store, clock, loss):
    submitted(store)
    claim = claim_one(store, "local:a")
    if loss == "lease":
        clock.advance(31.0)
        assert store.reap() == 1
    else:
        assert store.recover("local:") == 1
    assert store.complete(ticket(claim), run_fake(claim.job)).state == "done"
    # The same again is no news, and nobody gets the job any more.
    assert store.complete(ticket(claim), run_fake(claim.job)).state == "done"
    assert rows(store, "SELECT ending, next_state FROM attempt") == [
        (run_fake(claim.job).ending.value, "done")
    ]
    assert claim.job_id not in {other.job_id for other in store.claim("b", 100)}
    assert rows(store, "SELECT count(*) FROM solve")[0][0] == len(run_fake(claim.job).solves)
    kept = rows(store, "SELECT name, number FROM tally WHERE noun = 'attempt' AND number <> 0")
    assert kept == [(run_fake(claim.job).ending.value, 1)]


def test_a_result_that_comes_after_somebody_else_has_begun_is_stale(store, clock):
    submitted(store)
    claim = claim_one(store)
    clock.advance(31.0)
    store.reap()
    clock.advance(5.0)
    again = next(one for one in store.claim("b", 100) if one.job_id == claim.job_id)
    with pytest.raises(StaleAttempt):
        store.complete(ticket(claim), run_fake(claim.job))
    assert store.complete(ticket(again), run_fake(again.job)).state == "done"


@pytest.mark.parametrize("ending", [Ending.CRASH, Ending.CANCELLED, Ending.ERROR])
def test_what_is_no_result_does_not_take_a_job_out_of_the_queue(store, clock, ending):
    submitted(store)
    claim = claim_one(store)
    clock.advance(31.0)
    store.reap()
    with pytest.raises(StaleAttempt):
        store.complete(ticket(claim), JobOutcome(ending=ending))
    assert store.job(claim.job_id).state == "queued"


def test_a_result_of_the_job_of_another_archive_is_refused(store):
    submitted(store)
    claim = claim_one(store)
    outcome = run_fake(claim.job)
    with pytest.raises(StoreError, match="expected the outcome of this job, got that of another archive"):
        store.complete_many([Report(ticket(claim), outcome, "0" * 32)])
    assert store.complete_many([Report(ticket(claim), outcome, job_digest(claim.job))])[0].state == "done"


def test_an_outcome_whose_report_was_refused_can_be_handed_in_once_its_job_is_requeued(store):
    submitted(store)
    claim = claim_one(store)
    store.complete(ticket(claim), JobOutcome(ending=Ending.ERROR, error="report: expected one that is taken"))
    # A dead job stays dead, whoever says what.
    assert store.complete(ticket(claim), run_fake(claim.job)).state == "dead"
    store.requeue_job(claim.job_id)
    assert store.complete(ticket(claim), run_fake(claim.job)).state == "done"
