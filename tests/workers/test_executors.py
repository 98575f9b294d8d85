"""One contract for every executor, and what only a pool of processes can promise."""

import os
import signal
import time

import pytest

from tests.workers import fake
from tests.workers.jobs import hop_job
from workers.executor import ExecutorError, Ticket
from workers.inline import Inline
from workers.job import Ending
from workers.process_pool import ProcessPool

FAKE = "tests.workers.fake:"


def open_executor(kind, runner="run_fake", n_workers=1):
    if kind == "inline":
        return Inline(getattr(fake, runner))
    return ProcessPool(n_workers, FAKE + runner)


@pytest.fixture(params=["inline", "process"])
def executor(request):
    opened = open_executor(request.param)
    yield opened
    opened.close()


@pytest.fixture
def pool(request):
    opened = ProcessPool(2, FAKE + request.param)
    yield opened
    opened.close()


def collected(executor, n, seconds=20.0):
    deadline, done = time.monotonic() + seconds, []
    while len(done) < n and time.monotonic() < deadline:
        done.extend(executor.finished(0.1))
    return done


def test_an_outcome_is_what_the_runner_returned(executor):
    executor.submit(Ticket(5, 2), hop_job(chain=3, n_hops=4))
    (finished,) = collected(executor, 1)
    assert finished.ticket == Ticket(5, 2)
    assert finished.outcome == fake.run_fake(hop_job(chain=3, n_hops=4))


def test_every_ticket_comes_back_once(executor):
    for number in range(6):
        executor.submit(Ticket(number, 1), hop_job(chain=number))
        assert [done.ticket for done in collected(executor, 1)] == [Ticket(number, 1)]
    assert executor.finished(0.0) == []


def test_more_than_the_capacity_is_refused(executor):
    for number in range(executor.capacity()):
        executor.submit(Ticket(number, 1), hop_job())
    with pytest.raises(ExecutorError, match="at most 1 job"):
        executor.submit(Ticket(99, 1), hop_job())


def test_cancelling_an_unknown_ticket_changes_nothing(executor):
    executor.cancel(Ticket(77, 1))
    executor.submit(Ticket(1, 1), hop_job())
    assert collected(executor, 1)[0].outcome.ending is not Ending.CANCELLED


def test_a_job_that_waits_can_be_cancelled():
    executor = open_executor("inline")
    executor.submit(Ticket(1, 1), hop_job())
    executor.cancel(Ticket(1, 1))
    assert [done.outcome.ending for done in executor.finished(0.0)] == [Ending.CANCELLED]


@pytest.mark.parametrize("pool", ["run_until_stopped"], indirect=True)
def test_a_running_solve_sees_the_stop_flag(pool):
    pool.submit(Ticket(1, 1), hop_job())
    time.sleep(0.1)
    pool.cancel(Ticket(1, 1))
    assert [done.outcome.ending for done in collected(pool, 1)] == [Ending.CANCELLED]


@pytest.mark.parametrize("pool", ["run_deaf"], indirect=True)
def test_a_process_that_does_not_listen_is_killed_and_its_slot_starts_again(pool):
    pool.submit(Ticket(1, 1), hop_job())
    before = set(pool.processes())
    pool.cancel(Ticket(1, 1), force=True)
    assert [done.outcome.ending for done in collected(pool, 1)] == [Ending.CANCELLED]
    assert pool.capacity() == 2 and len(set(pool.processes()) - before) == 1


@pytest.mark.parametrize("pool", ["run_deaf"], indirect=True)
def test_a_killed_process_is_a_crash_of_its_own_job_alone(pool):
    pool.submit(Ticket(1, 1), hop_job())
    pool.submit(Ticket(2, 1), hop_job())
    victim = next(pid for pid, ticket in pool.processes().items() if ticket == Ticket(1, 1))
    os.kill(victim, signal.SIGKILL)
    (finished,) = collected(pool, 1)
    assert finished.ticket == Ticket(1, 1) and finished.outcome.ending is Ending.CRASH
    assert "exit code -9" in finished.outcome.error
    assert Ticket(2, 1) in pool.processes().values()


@pytest.mark.parametrize("pool", ["run_chain_one_suicidal"], indirect=True)
def test_a_slot_works_on_after_a_crash(pool):
    endings = []
    for number in (1, 2, 1, 2):
        pool.submit(Ticket(number, 1), hop_job(chain=number))
        endings += [done.outcome.ending is Ending.CRASH for done in collected(pool, 1)]
    assert endings == [True, False, True, False]


@pytest.mark.parametrize("pool", ["run_reporting_threads"], indirect=True)
def test_a_pool_process_is_another_process_with_one_thread(pool):
    pool.submit(Ticket(1, 1), hop_job())
    pid, variable, threads = collected(pool, 1)[0].outcome.error.split(maxsplit=2)
    assert int(pid) != os.getpid() and variable == "1" and threads == "[1]"


@pytest.mark.parametrize("pool", ["run_printing"], indirect=True)
def test_what_a_solver_prints_does_not_disturb_the_reply(pool):
    pool.submit(Ticket(1, 1), hop_job())
    assert collected(pool, 1)[0].outcome == fake.run_fake(hop_job())


def test_a_pool_without_processes_is_refused():
    with pytest.raises(ExecutorError, match="at least 1, got 0"):
        ProcessPool(0)
