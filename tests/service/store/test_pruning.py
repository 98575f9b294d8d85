import threading

import pytest

from service.coordinator.reaper import Reaper
from service.schemas.identity import Role
from service.store import leases
from service.store.store import Store
from tests.service.campaigns import finish, submitted
from tests.service.clock import Clock
from tests.service.databases import needs_postgres


@pytest.fixture
def clock():
    return Clock(1.8e9)


@pytest.fixture
def clocked(tmp_path, clock):
    with Store(tmp_path, clock=clock) as opened:
        yield opened


def audited(store, n):
    for number in range(n):
        store.identities.record(None, "127.0.0.1", "POST", f"/{number}", 401)


def paths(store):
    return [row.path for row in store.identities.audit(200).items]


def test_of_the_audit_a_number_of_rows_stays_and_they_are_the_newest(clocked, monkeypatch):
    monkeypatch.setattr(leases, "AUDIT_ROWS", 3)
    audited(clocked, 9)
    assert clocked.prune() == 6 and clocked.prune() == 0
    assert paths(clocked) == ["/8", "/7", "/6"]


def test_what_is_older_than_a_year_leaves_the_audit_but_never_all_of_it(clocked, clock):
    audited(clocked, 3)
    clock.advance(300 * leases.DAY_S)
    audited(clocked, 2)
    assert clocked.prune() == 0
    clock.advance(101 * leases.DAY_S)
    assert clocked.prune() == 3 and paths(clocked) == ["/1", "/0"]
    clock.advance(999 * leases.DAY_S)
    # The last row stays, so that no id is given twice.
    assert clocked.prune() == 1 and paths(clocked) == ["/1"]


def test_a_token_is_forgotten_only_when_the_audit_no_longer_names_it(clocked, clock):
    made = clocked.identities.create("ada", Role.ADMIN, 1.0)
    clocked.identities.record(clocked.identities.identify(made.token), "127.0.0.1", "POST", "/", 201)
    audited(clocked, 1)
    clock.advance(401 * leases.DAY_S)
    clocked.identities.replace("ada", Role.ADMIN, 1.0)
    assert len(clocked.identities.tokens()) == 2
    clocked.prune()
    clocked.identities.replace("ada", Role.ADMIN, 1.0)
    assert len(clocked.identities.tokens()) == 1


@pytest.mark.parametrize("store", ["sqlite", pytest.param("postgresql", marks=needs_postgres)], indirect=True)
def test_of_the_events_the_newest_stay_and_streams_go_on_from_any_id(store, monkeypatch):
    submitted(store)
    finish(store)
    before = store.events(0, 1, 200)
    monkeypatch.setattr(leases, "EVENT_ROWS", 5)
    assert store.prune() == len(before) - 5
    assert store.events(0, 1, 200) == store.events(before[2].id, 1, 200) == before[-5:]
    assert store.last_event_id(1) == before[-1].id and store.campaign(1).n_solutions


def test_the_reaper_forgets_some_rows_at_a_time(clocked, clock, monkeypatch):
    monkeypatch.setattr(leases, "AUDIT_ROWS", 2)
    monkeypatch.setattr(leases, "STEP", 4)
    audited(clocked, 12)
    reaper = Reaper(clocked, threading.Event(), clock)
    left = []
    for _ in range(4):
        clock.advance(60.0)
        reaper.step()
        left.append(len(paths(clocked)))
    assert left == [8, 4, 2, 2]
