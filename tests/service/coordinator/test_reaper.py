import threading

import pytest
from sqlalchemy.exc import OperationalError

from service.coordinator.reaper import Reaper
from service.scheduler.leases import LeaseSettings, backoff_s
from service.store import Store
from tests.service.campaigns import submitted
from tests.service.clock import Clock


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
    clock.advance(29.9)
    assert reaper.step() == 0
    clock.advance(0.1)
    assert reaper.step() == 2 and reaper.step() == 0


def test_a_reaper_looks_again_after_its_period_alone(clocked, clock, monkeypatch):
    calls = []
    monkeypatch.setattr(clocked, "reap", lambda: calls.append(clock.now) or 0)
    reaper = Reaper(clocked, threading.Event(), clock)
    for _ in range(40):
        clock.advance(1.0)
        reaper.step()
    assert calls == [1_000_030.0, 1_000_035.0, 1_000_040.0]


def test_a_reaper_outlives_a_database_that_fails(clocked, clock, monkeypatch):
    def full():
        raise OperationalError("UPDATE job", {}, Exception("disk is full"))

    reaper = Reaper(clocked, threading.Event(), clock)
    submitted(clocked)
    clocked.claim("a", 1)
    clock.advance(31.0)
    with monkeypatch.context() as patch:
        patch.setattr(clocked, "reap", full)
        assert reaper.step() == 0
    clock.advance(5.0)
    assert reaper.step() == 1


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
