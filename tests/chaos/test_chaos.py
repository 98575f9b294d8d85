"""The short version of `make chaos`, and whether the suite would notice what must not happen."""

import shutil
import sqlite3
import time
from contextlib import closing
from random import Random
from types import SimpleNamespace

import pytest

from service.spec import spec_from
from tests.chaos.fire import AtRandom
from tests.chaos.prober import Prober
from tests.chaos.round import Round, RoundOrder, campaign_fields
from tests.chaos.site import COORDINATOR, DISPATCHER, POOL_WORKER, SiteOrder
from tests.chaos.suite import ROUNDS
from tests.chaos.verdict import faults_of, undisturbed

SHORT = RoundOrder(
    "short",
    SiteOrder(has_remote=False, lease_s=3.0),
    AtRandom({COORDINATOR: 2, DISPATCHER: 2, POOL_WORKER: 2}, (0.2, 1.2)),
    guesses=10,
)


@pytest.mark.slow
def test_what_is_killed_costs_no_job_no_outcome_and_no_bit(tmp_path):
    told = Round(SHORT, tmp_path, Random(5)).run()
    assert told["faults"] == []
    assert told["kills"] == {COORDINATOR: 2, DISPATCHER: 2, POOL_WORKER: 2}
    assert told["probes"]["failed"] == 0 and told["probes"]["n"] > 5


@pytest.fixture(scope="module")
def archives(tmp_path_factory):
    """Give an archive twice, as of two runs."""
    folder = tmp_path_factory.mktemp("archives")
    undisturbed(folder / "one", [campaign_fields(SHORT, 0)])
    shutil.copytree(folder / "one", folder / "two")
    return folder / "one", folder / "two"


@pytest.mark.parametrize("order", ROUNDS, ids=lambda order: order.name)
def test_the_campaigns_of_every_round_are_such_as_a_coordinator_takes(order):
    assert len(spec_from(campaign_fields(order, 1)).search) == 4 + order.is_choosing


def test_the_suite_kills_two_hundred_times():
    # The number; those of the round that measures come on top.
    n_kills = [sum(order.fire.n_kills.values()) for order in ROUNDS if isinstance(order.fire, AtRandom)]
    assert sum(n_kills) >= 200


def test_two_runs_of_one_campaign_are_equal(archives):
    assert faults_of(*archives, seen_done={1: 1}) == []


#: What may not happen, done to an archive, with what has to be said of it.
CRIMES = (
    ("UPDATE solve SET objective_kg = objective_kg + 1e-9", "solve: expected the"),
    ("DELETE FROM seed_link WHERE rowid = 1", "seed_link: expected the"),
    ("INSERT INTO seed_link SELECT seed_id, solution_id, mapping FROM seed_link", "no circle, got"),
    ("UPDATE attempt SET next_state = NULL WHERE job_id = 2", "not exactly one accepted outcome: [(2, 0)]"),
    (
        "UPDATE attempt SET next_state = 'queued' WHERE job_id = 2",
        "not exactly one accepted outcome: [(2, 0)]",
    ),
    ("DELETE FROM solve WHERE job_id = 3 AND hop = 1", "solves of a job are missing: [(3, 2, 1)]"),
    (
        "INSERT INTO attempt (job_id, attempt, worker, started_at, ended_at, ending, next_state)"
        " SELECT job_id, 2, worker, started_at, ended_at, ending, next_state FROM attempt WHERE job_id = 4",
        "not exactly one accepted outcome: [(4, 2)]",
    ),
    ("UPDATE job SET attempt = 2 WHERE id = 1", "jobs [1]: expected to stay done by the same attempt"),
    ("UPDATE search SET n_solves = 1", "db check totals"),
)


@pytest.mark.parametrize(("wrong", "noticed"), CRIMES)
def test_whatever_differs_is_noticed(archives, tmp_path, wrong, noticed):
    shutil.copytree(archives[0], tmp_path / "disturbed")
    with closing(sqlite3.connect(tmp_path / "disturbed" / "coastarc.db")) as connection:
        connection.execute(wrong)
        connection.commit()
    found = faults_of(tmp_path / "disturbed", archives[1], seen_done={1: 1})
    assert any(noticed in fault for fault in found), found


def test_silence_is_excused_after_a_kill_alone():
    site = SimpleNamespace(url="http://127.0.0.1:9", last_kill=0.0)
    prober = Prober(site)
    prober._probe("/healthz")
    assert (prober.probes.n_excused, prober.probes.failures) == (1, [])
    prober._answered = site.last_kill
    prober._probe("/healthz")
    assert len(prober.probes.failures) == 1 and "ConnectError" in prober.probes.failures[0]
    site.last_kill = time.monotonic()
    prober._probe("/healthz")
    assert prober.probes.n_excused == 2
    prober._http.close()
