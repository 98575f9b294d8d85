"""The store's contract on PostgreSQL: the tests of the SQLite archive again, each in a new database."""

import time

import pytest

from service.store.store import Store
from tests.service.campaigns import submitted
from tests.service.databases import needs_postgres, rows
from tests.service.store import test_seeds_elsewhere, test_store
from tests.workers.jobs import worker_info

pytestmark = [pytest.mark.postgres, needs_postgres, pytest.mark.usefixtures("archives_on_postgres")]

#: What another test of these shows as well is left to SQLite.
NAMES = """
    a_campaign_ends_by_itself_and_feeds_its_own_seeds
    every_strict_solution_is_mapped_exactly_once
    infeasible_solves_are_stored_with_their_defects_and_times
    the_same_specification_again_is_the_same_campaign
    a_job_is_handed_out_once
    a_late_report_of_an_older_attempt_changes_nothing
    a_bug_of_ours_is_dead_at_once_and_keeps_its_traceback
    a_job_that_was_interrupted_keeps_its_solves_and_runs_again
    what_a_dead_process_left_running_is_finished_with_the_same_result
    ordered_seeds_wait_for_their_search_and_the_best_go_first
    a_budget_in_solutions_ends_a_search
    a_map_job_carries_its_seed_bit_by_bit
    one_solution_in_two_campaigns_is_stored_once_and_listed_in_both
    seeds_of_another_campaign_that_do_not_fit_are_refused_and_nothing_is_stored
    facts_of_a_campaign_are_those_of_its_records
    a_limit_gives_the_best_solutions
"""
CONTRACT = vars(test_store) | vars(test_seeds_elsewhere)
globals().update({f"test_{name}": CONTRACT[f"test_{name}"] for name in NAMES.split()})


@pytest.fixture
def store(monkeypatch, tmp_path, archives_on_postgres):
    monkeypatch.setattr(test_store, "rows", rows)
    with Store(tmp_path) as opened:
        yield opened


def test_coordinators_whose_clocks_differ_take_no_job_from_each_other(store, tmp_path, monkeypatch):
    submitted(store)
    assert len(store.claim("a", 2)) == 2
    for ahead_s in (3600.0, -3600.0):
        with Store(tmp_path) as other, monkeypatch.context() as patch:
            patch.setattr(other, "_clock", lambda: time.time() + ahead_s)  # noqa: B023 - asked at once
            assert other.reap(other.now()) == 0 and other.claim("b", 1) != []
            other.register(worker_info("b"))
            assert abs(other.now() - store.now()) < 60.0  # the time that the questions take
            assert other.gauges.n_workers() == 1 == len([w for w in other.workers().items if w.is_alive])
    leases = rows(store, "SELECT max(lease_until) - min(lease_until) FROM job WHERE state = 'running'")
    assert leases[0][0] < 60.0 and store.reap() == 0
