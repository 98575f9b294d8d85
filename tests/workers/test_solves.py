"""Jobs with the real solver, kept short by a cap on iterations; most of what they find is infeasible."""

import time

import pytest

from core.search import HopSettings
from tests.workers.fake import opened
from tests.workers.jobs import hop_job
from workers.executor import ProcessPool
from workers.messages import Ending, JobSettings, Ticket
from workers.process_tree import THREAD_VARIABLES
from workers.run import run_job

#: The first job of a process may have to compile [s].
PATIENCE_S = 400.0
VOLATILE = {"cpu_seconds", "wall_seconds"}


@pytest.fixture(scope="module")
def pool():
    opened = ProcessPool(2)
    yield opened
    opened.close()


def collected(pool, n):
    deadline, done = time.monotonic() + PATIENCE_S, {}
    while len(done) < n and time.monotonic() < deadline:
        done |= {finished.ticket.job_id: opened(finished.outcome) for finished in pool.finished(0.1)}
    return done


def numbers(outcome):
    assert outcome.error is None
    return [solve.model_dump(exclude=VOLATILE) for solve in outcome.solves]


def test_a_solve_is_recorded_with_defects_times_and_provenance():
    outcome = run_job(hop_job(n_hops=2))
    assert outcome.error is None and len(outcome.solves) == 2
    for solve in outcome.solves:
        assert len(solve.defects) == 1 and len(solve.defects[0]) == 7
        assert solve.n_evaluations > 0 and 0 < solve.cpu_seconds <= solve.wall_seconds + 0.01
    assert outcome.provenance.kernel_hashes and outcome.provenance.code_version.startswith("0.")


def test_two_processes_and_this_one_find_the_same_bits(pool):
    jobs = [
        hop_job(chain=chain, n_hops=2, laws=HopSettings(guess_law="thrust-coast-thrust")) for chain in (0, 1)
    ]
    for chain, job in enumerate(jobs):
        pool.submit(Ticket(chain, 1), job)
    found = collected(pool, 2)
    assert [numbers(found[chain]) for chain in (0, 1)] == [numbers(run_job(job)) for job in jobs]
    assert numbers(found[0]) != numbers(found[1])


def test_a_solve_inside_ipopt_stops_when_asked(pool):
    pool.submit(Ticket(1, 1), hop_job(n_hops=1000, settings=JobSettings(cpu_seconds=600)))
    time.sleep(1.0)
    begin = time.monotonic()
    pool.cancel(Ticket(1, 1))
    assert collected(pool, 1)[1].ending is Ending.CANCELLED
    assert time.monotonic() - begin < 60.0  # where the solves would go on for hours


def test_a_real_solve_leaves_one_thread_in_force(monkeypatch):
    for name in THREAD_VARIABLES:
        monkeypatch.setenv(name, "2")
    measuring = ProcessPool(1, "tests.workers.fake:run_solving_then_reporting_threads")
    measuring.submit(Ticket(1, 1), hop_job())
    told = collected(measuring, 1)[1].error
    measuring.close()
    assert told == "before [1], during [1], after [1], OMP_NUM_THREADS 1"
