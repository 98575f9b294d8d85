import threading

import pytest
from sqlalchemy.exc import OperationalError

from service.coordinator.reaper import Reaper
from service.scheduler import LeaseSettings, backoff_s
from service.store.store import Store
from tests.service.campaigns import submitted
from tests.service.clock import Clock
from tests.service.databases import rows
from tests.workers.jobs import worker_info
from workers.messages import Ticket


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def clocked(tmp_path, clock):
    with Store(tmp_path, clock=clock) as opened:
        yield opened


def test_a_new_coordinator_gives_workers_one_lease_to_come_back(clocked, clock):
    submitted(clocked)
    clocked.claim("a", 2)
    clock.advance(100.0)
    reaper = Reaper(clocked, threading.Event(), clock)
    assert looks(reaper, [clock], 5) == [0] * 5
    clock.advance(4.9)
    assert reaper.step() == 0
    clock.advance(0.1)
    assert reaper.step() == 2 and reaper.step() == 0


def test_a_reaper_looks_again_after_its_period_alone(clocked, clock, monkeypatch):
    calls = []
    monkeypatch.setattr(clocked, "reap", lambda _: calls.append(clock.now) or 0)
    reaper = Reaper(clocked, threading.Event(), clock)
    for _ in range(40):
        clock.advance(1.0)
        reaper.step()
    assert calls == [1_000_030.0, 1_000_035.0, 1_000_040.0]


def test_a_reaper_outlives_a_database_that_fails(clocked, clock, monkeypatch):
    def full(_):
        raise OperationalError("UPDATE job", {}, Exception("disk is full"))

    reaper = Reaper(clocked, threading.Event(), clock)
    submitted(clocked)
    clocked.claim("a", 1)
    with monkeypatch.context() as patch:
        patch.setattr(clocked, "reap", full)
        assert looks(reaper, [clock], 7) == [0] * 7
    # Workers could not renew their leases either, so they get new ones.
    n_lost = []
    for _ in range(8):
        clock.advance(5.0)
        n_lost.append(reaper.step())
    assert n_lost == [0, 0, 0, 0, 0, 0, 0, 1]


def test_a_reaper_stops_when_told_and_not_a_lease_later(clocked):
    stop = threading.Event()
    thread = threading.Thread(target=Reaper(clocked, stop).run)
    thread.start()
    stop.set()
    thread.join(30.0)  # a lease is longer
    assert not thread.is_alive()


def test_waits_double_up_to_a_minute():
    assert [backoff_s(n) for n in (0, 1, 2, 3, 6, 7, 500)] == [0, 1, 2, 4, 32, 60, 60]


def test_leases_that_would_rob_workers_that_are_well_are_refused():
    with pytest.raises(ValueError, match="expected 0 < heartbeat_s < lease_s"):
        LeaseSettings(lease_s=5.0, heartbeat_s=5.0)


@pytest.fixture
def watched(clocked):
    """A store with two running jobs, a reaper past its first look, and its monotonic clock."""
    submitted(clocked)
    clocked.claim("a", 2)
    monotonic = Clock(500.0)
    return Reaper(clocked, threading.Event(), monotonic), monotonic


def looks(reaper, clocks, n_looks, before_look=lambda: None):
    """Let time go on by the period of the reaper so often; return what each look took back."""
    found = []
    for _ in range(n_looks):
        for clock in clocks:
            clock.advance(5.0)
        before_look()
        found.append(reaper.step())
    return found


def failures(store):
    return [tuple(row) for row in rows(store, "SELECT n_failures, state FROM job WHERE attempt > 0")]


@pytest.mark.parametrize("hours", [0.01, 1.0, 10_000.0, -0.01, -5.0])
def test_a_clock_that_is_set_takes_no_job_from_a_worker_that_is_well(clocked, clock, watched, hours):
    reaper, monotonic = watched
    held = [Ticket(job.id, 1) for job in clocked.jobs(None, None, "running", 10).items]
    beat = lambda: clocked.heartbeat("a", held)  # noqa: E731
    for _ in range(5):
        assert looks(reaper, (clock, monotonic), 7, beat) == [0] * 7
        clock.advance(3600.0 * hours)
        # The look comes before the next heartbeat.
        assert looks(reaper, (clock, monotonic), 1) == [0]
    assert failures(clocked) == [(0, "running")] * 2
    # And a worker that is gone is noticed all the same.
    assert sum(looks(reaper, (clock, monotonic), 14)) == 2


def test_a_coordinator_that_stood_still_gives_new_leases_and_reaps_a_lease_later(
    clocked, clock, watched, caplog
):
    reaper, monotonic = watched
    for _ in range(3):
        clock.advance(36.0)
        monotonic.advance(36.0)
        assert reaper.step() == 0
    assert failures(clocked) == [(0, "running")] * 2
    assert sum(looks(reaper, (clock, monotonic), 7)) == 2 and failures(clocked) == [(1, "queued")] * 2
    assert "as after a pause; 2 running jobs get a new one" in caplog.text


def test_a_late_wake_that_leaves_time_for_a_heartbeat_is_none(clocked, clock, watched):
    reaper, monotonic = watched
    assert looks(reaper, (clock, monotonic), 5) == [0] * 5
    clock.advance(14.0)
    monotonic.advance(14.0)
    assert reaper.step() == 2


def test_a_lease_beyond_any_that_is_given_begins_again(clocked, clock, watched):
    reaper, monotonic = watched
    # As in an archive that was stopped before its clock was set back.
    with clocked._database._writer.begin() as connection:
        connection.exec_driver_sql("UPDATE job SET lease_until = lease_until + 18000 WHERE state = 'running'")
    assert sum(looks(reaper, (clock, monotonic), 14)) == 2


def test_a_wait_that_no_failure_can_lead_to_is_none(clocked, clock):
    submitted(clocked)
    with clocked._database._writer.begin() as connection:
        connection.exec_driver_sql(f"UPDATE job SET n_failures = 1, not_before = {clock.now + 18000}")
    assert len(clocked.claim("a", 10)) == 4
    with clocked._database._writer.begin() as connection:
        put_back = f"state = 'queued', lease_until = NULL, not_before = {clock.now + 59}"
        connection.exec_driver_sql(f"UPDATE job SET {put_back}")
    assert clocked.claim("a", 10) == []


def test_pages_of_an_archive_whose_clock_was_set_back_have_no_negative_times(clocked, clock):
    campaign_id = submitted(clocked)
    clocked.register(worker_info("a"))
    clocked.claim("a", 2)
    clock.advance(-18000.0)
    assert clocked.campaign(campaign_id).elapsed_seconds == 0.0
    assert [worker.is_alive for worker in clocked.workers().items] == [False]
    assert clocked.gauges.n_workers() == 0 and clocked.gauges.read().oldest_lease_s == 0.0
    assert clocked.activity.queue().jobs.running == 2 and clocked.campaign_cards()
