"""States, leases and control on PostgreSQL: the tests of the SQLite archive again."""

import pytest

from service.store.store import Store
from tests.service.clock import Clock
from tests.service.databases import needs_postgres, rows
from tests.service.store import test_lifecycle as contract

pytestmark = [pytest.mark.postgres, needs_postgres, pytest.mark.usefixtures("archives_on_postgres")]

#: What writes to SQLite's file past the store, or is long and the same on any database.
ELSEWHERE = {
    "test_the_database_makes_the_changes_of_the_table_and_no_other",
    "test_a_job_has_a_lease_while_it_runs_and_at_no_other_time",
    "test_searches_of_equal_priority_share_by_weight",
    "test_a_search_that_comes_back_does_not_make_up_for_its_absence",
    "test_a_pause_changes_nothing_in_what_is_found",
}
globals().update(
    {
        name: getattr(contract, name)
        for name in dir(contract)
        if name.startswith("test_") and name not in ELSEWHERE
    }
)


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def store(monkeypatch, tmp_path, clock, archives_on_postgres):
    monkeypatch.setattr(contract, "rows", rows)
    with Store(tmp_path, clock=clock) as opened:
        yield opened
