"""One contract for every executor, and what only a pool of processes can promise; Ray's is in test_ray."""

import os
import signal
import time

import psutil
import pytest

from tests.workers import fake
from tests.workers.jobs import hop_job
from workers.executor import ExecutorError, Inline, ProcessPool
from workers.messages import Ending, Ticket
from workers.process_tree import THREAD_VARIABLES

FAKE = "tests.workers.fake:"
RAY = pytest.param("ray", marks=pytest.mark.ray)


@pytest.fixture
def opened(request):
    """Give a function that opens an executor of a kind; all are closed afterwards."""
    executors = []

    def open_executor(kind, runner="run_fake", n_workers=2, **options):
        executors.append(executor_of(kind, runner, n_workers, request, options))
        return executors[-1]

    yield open_executor
    for executor in executors:
        executor.close()


def executor_of(kind, runner, n_workers, request, options):
    if kind == "inline":
        return Inline(getattr(fake, runner))
    if kind == "process":
        return ProcessPool(n_workers, FAKE + runner, **options)
    from workers.ray_executor import RayExecutor

    return RayExecutor(request.getfixturevalue("ray_cluster"), FAKE + runner, **options)


every_kind = pytest.mark.parametrize("kind", ["inline", "process", RAY])
with_processes = pytest.mark.parametrize("kind", ["process", RAY])


@pytest.fixture
def pool(request):
    opened = ProcessPool(2, FAKE + request.param)
    yield opened
    opened.close()


def collected(executor, n, seconds=60.0):
    deadline, done = time.monotonic() + seconds, []
    while len(done) < n and time.monotonic() < deadline:
        done.extend(executor.finished(0.1))
    return done


def endings(executor, n):
    return [done.outcome.head.ending for done in collected(executor, n)]


@every_kind
def test_an_outcome_is_what_the_runner_returned(opened, kind):
    executor = opened(kind)
    executor.submit(Ticket(5, 2), hop_job(chain=3, n_hops=4))
    (finished,) = collected(executor, 1)
    assert finished.ticket == Ticket(5, 2)
    assert fake.opened(finished.outcome) == fake.run_fake(hop_job(chain=3, n_hops=4))


@every_kind
def test_every_ticket_comes_back_once(opened, kind):
    executor = opened(kind)
    for number in range(6):
        executor.submit(Ticket(number, 1), hop_job(chain=number))
        assert [done.ticket for done in collected(executor, 1)] == [Ticket(number, 1)]
    assert executor.finished(0.0) == []


@every_kind
def test_as_many_jobs_as_the_capacity_are_accepted_and_no_more(opened, kind):
    executor = opened(kind, "run_slowly")
    n = executor.capacity()
    for _ in range(2):
        tickets = [Ticket(number, 1) for number in range(n)]
        for ticket in tickets:
            executor.submit(ticket, hop_job())
        with pytest.raises(ExecutorError, match=f"at most {n} job"):
            executor.submit(Ticket(99, 1), hop_job())
        assert sorted(done.ticket for done in collected(executor, n)) == tickets


@every_kind
def test_cancelling_an_unknown_ticket_changes_nothing(opened, kind):
    executor = opened(kind)
    executor.cancel(Ticket(77, 1))
    executor.cancel(Ticket(77, 1), force=True)
    executor.submit(Ticket(1, 1), hop_job())
    assert collected(executor, 1)[0].outcome.head.ending is not Ending.CANCELLED


def test_a_job_that_waits_can_be_cancelled(opened):
    executor = opened("inline")
    executor.submit(Ticket(1, 1), hop_job())
    executor.cancel(Ticket(1, 1))
    assert [done.outcome.head.ending for done in executor.finished(0.0)] == [Ending.CANCELLED]


@with_processes
def test_a_running_solve_sees_the_stop_flag_and_its_outcome_counts(opened, kind):
    executor = opened(kind, "run_until_stopped")
    executor.submit(Ticket(1, 1), hop_job())
    assert executor.finished(3.0) == []
    executor.cancel(Ticket(1, 1))
    (finished,) = collected(executor, 1)
    # Only the runner itself knows its provenance: it was not killed, but returned.
    head = finished.outcome.head
    assert head.ending is Ending.CANCELLED and head.provenance == fake.PROVENANCE


@with_processes
def test_a_job_that_does_not_listen_is_killed_by_force(opened, kind):
    executor = opened(kind, "run_chain_zero_deaf")
    executor.submit(Ticket(1, 1), hop_job(chain=0))
    assert executor.finished(1.0) == []
    executor.cancel(Ticket(1, 1), force=True)
    assert endings(executor, 1) == [Ending.CANCELLED]
    executor.submit(Ticket(2, 1), hop_job(chain=2))
    assert endings(executor, 1) == [fake.run_fake(hop_job(chain=2)).ending]


@with_processes
def test_a_job_that_does_not_listen_is_killed_after_the_grace(opened, kind):
    executor = opened(kind, "run_deaf", grace_s=0.5)
    executor.submit(Ticket(1, 1), hop_job())
    assert executor.finished(1.0) == []
    executor.cancel(Ticket(1, 1))
    assert endings(executor, 1) == [Ending.CANCELLED]


@with_processes
def test_jobs_come_back_in_the_order_in_which_they_end(opened, kind):
    executor = opened(kind, "run_chain_zero_deaf")
    executor.submit(Ticket(1, 1), hop_job(chain=0))
    executor.submit(Ticket(2, 1), hop_job(chain=2))
    assert [done.ticket for done in collected(executor, 1)] == [Ticket(2, 1)]
    executor.cancel(Ticket(1, 1), force=True)
    assert [done.ticket for done in collected(executor, 1)] == [Ticket(1, 1)]


@with_processes
def test_an_executor_works_on_after_a_crash(opened, kind):
    executor = opened(kind, "run_chain_one_suicidal", n_workers=1)
    crashed = []
    for number in (1, 2, 1, 2):
        executor.submit(Ticket(number, 1), hop_job(chain=number))
        (finished,) = collected(executor, 1)
        crashed.append(finished.outcome.head.ending is Ending.CRASH)
        assert ("worker process: expected a reply, got" in (finished.outcome.head.error or "")) is crashed[-1]
    assert crashed == [True, False, True, False]


@with_processes
def test_a_job_runs_in_another_process_with_one_thread(opened, kind, monkeypatch):
    for name in THREAD_VARIABLES:
        monkeypatch.setenv(name, "2")
    executor = opened(kind, "run_reporting_threads")
    executor.submit(Ticket(1, 1), hop_job())
    pid, variable, threads = collected(executor, 1)[0].outcome.head.error.split(maxsplit=2)
    assert int(pid) != os.getpid() and variable == "1" and threads == "[1]"


@with_processes
def test_what_a_solver_prints_does_not_disturb_the_reply(opened, kind):
    executor = opened(kind, "run_printing")
    executor.submit(Ticket(1, 1), hop_job())
    assert fake.opened(collected(executor, 1)[0].outcome) == fake.run_fake(hop_job())


def test_a_closed_pool_leaves_no_process_even_of_a_deaf_job():
    pool = ProcessPool(2, FAKE + "run_deaf")
    pool.submit(Ticket(1, 1), hop_job())
    processes = [psutil.Process(pid) for pid in pool.processes()]
    pool.close()
    assert not any(process.is_running() for process in processes)


@pytest.mark.parametrize("pool", ["run_deaf"], indirect=True)
def test_a_process_that_does_not_listen_is_killed_and_its_slot_starts_again(pool):
    pool.submit(Ticket(1, 1), hop_job())
    before = set(pool.processes())
    pool.cancel(Ticket(1, 1), force=True)
    assert [done.outcome.head.ending for done in collected(pool, 1)] == [Ending.CANCELLED]
    assert pool.capacity() == 2 and len(set(pool.processes()) - before) == 1


@pytest.mark.parametrize("pool", ["run_deaf"], indirect=True)
def test_a_killed_process_is_a_crash_of_its_own_job_alone(pool):
    pool.submit(Ticket(1, 1), hop_job())
    pool.submit(Ticket(2, 1), hop_job())
    victim = next(pid for pid, ticket in pool.processes().items() if ticket == Ticket(1, 1))
    os.kill(victim, signal.SIGKILL)
    (finished,) = collected(pool, 1)
    assert finished.ticket == Ticket(1, 1) and finished.outcome.head.ending is Ending.CRASH
    assert "exit code -9" in finished.outcome.head.error
    assert Ticket(2, 1) in pool.processes().values()


@pytest.mark.parametrize("pool", ["run_chain_one_breaking_off"], indirect=True)
def test_a_process_that_dies_within_its_reply_is_a_crash_of_its_own_job_alone(pool):
    pool.submit(Ticket(1, 1), hop_job(chain=1))
    pool.submit(Ticket(2, 1), hop_job(chain=2))
    crashed = {done.ticket: done.outcome.head.ending is Ending.CRASH for done in collected(pool, 2)}
    assert crashed == {Ticket(1, 1): True, Ticket(2, 1): False}


def test_a_process_that_is_killed_after_its_reply_gets_no_further_job():
    pool = ProcessPool(1, FAKE + "run_fake")
    try:
        pool.submit(Ticket(1, 1), hop_job())
        while pool._replies.empty():
            time.sleep(0.01)
        pool.cancel(Ticket(1, 1), force=True)
        for number in (1, 2):
            (finished,) = collected(pool, 1)
            assert finished.ticket == Ticket(number, 1)
            assert fake.opened(finished.outcome) == fake.run_fake(hop_job())
            pool.submit(Ticket(number + 1, 1), hop_job())
    finally:
        pool.close()


def test_a_pool_without_processes_is_refused():
    with pytest.raises(ExecutorError, match="at least 1, got 0"):
        ProcessPool(0)
