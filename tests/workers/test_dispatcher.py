"""The loop between a source of jobs and an executor, with a source that lives in memory."""

import threading
import time

from tests.workers.fake import run_fake
from tests.workers.jobs import hop_job
from workers.dispatcher import Dispatcher, StaleAttempt
from workers.executor import Ticket
from workers.inline import Inline
from workers.job import Claim, Ending, wall_limit_s
from workers.process_pool import ProcessPool


class ListSource:
    """Hands out jobs from a list and remembers what came back."""

    def __init__(self, n_jobs, cancelled=()):
        self.waiting = [Claim(job_id=i, attempt=1, job=hop_job(chain=i)) for i in range(n_jobs)]
        self.cancelled = cancelled
        self.reported = {}
        self.most_held = 0

    def claim(self, worker, n_jobs):
        claimed, self.waiting = self.waiting[:n_jobs], self.waiting[n_jobs:]
        return claimed

    def heartbeat(self, worker, held):
        self.most_held = max(self.most_held, len(held))
        return [ticket for ticket in held if ticket.job_id in self.cancelled]

    def complete(self, ticket, outcome):
        assert ticket not in self.reported
        self.reported[ticket] = outcome


class DeafSource(ListSource):
    """Refuses every report, as after a lease that was taken over."""

    def complete(self, ticket, outcome):
        raise StaleAttempt("job: expected to hold it, got a stale report")


def work(dispatcher, is_done, seconds=20.0):
    deadline = time.monotonic() + seconds
    dispatcher.run(lambda: is_done() or time.monotonic() > deadline)


def test_every_job_is_reported_once_with_its_own_outcome():
    source = ListSource(7)
    work(Dispatcher(source, Inline(run_fake), "w"), lambda: len(source.reported) == 7)
    assert source.reported == {Ticket(i, 1): run_fake(hop_job(chain=i)) for i in range(7)}


def test_no_more_is_claimed_than_runs_at_once():
    source, pool = ListSource(9), ProcessPool(2, "tests.workers.fake:run_fake")
    work(Dispatcher(source, pool, "w", heartbeat_s=0.0), lambda: len(source.reported) == 9)
    pool.close()
    assert len(source.reported) == 9 and source.most_held == 2


def test_a_report_that_is_refused_does_not_stop_the_work():
    source = DeafSource(3)
    work(Dispatcher(source, Inline(run_fake), "w"), lambda: not source.waiting)
    assert source.waiting == []


def test_a_heartbeat_cancels_what_the_source_wants_back():
    source, pool = ListSource(2, cancelled=(1,)), ProcessPool(2, "tests.workers.fake:run_until_stopped")
    dispatcher = Dispatcher(source, pool, "w", heartbeat_s=0.0)
    work(dispatcher, lambda: bool(source.reported))
    pool.close()
    assert source.reported[Ticket(1, 1)].ending is Ending.CANCELLED


def test_stopping_hands_in_what_runs():
    source, pool, stop = (
        ListSource(2),
        ProcessPool(2, "tests.workers.fake:run_until_stopped"),
        threading.Event(),
    )
    threading.Timer(0.5, stop.set).start()
    Dispatcher(source, pool, "w").run(stop.is_set)
    pool.close()
    assert [outcome.ending for outcome in source.reported.values()] == [Ending.CANCELLED] * 2


def test_stopping_kills_what_does_not_listen(monkeypatch):
    monkeypatch.setattr("workers.dispatcher.GRACE_S", 0.3)
    source, pool, stop = ListSource(1), ProcessPool(1, "tests.workers.fake:run_deaf"), threading.Event()
    threading.Timer(0.3, stop.set).start()
    Dispatcher(source, pool, "w").run(stop.is_set)
    pool.close()
    assert source.reported[Ticket(0, 1)].ending is Ending.CANCELLED


def test_a_job_that_hangs_is_killed_and_its_slot_works_on(monkeypatch):
    monkeypatch.setattr(
        "workers.dispatcher.wall_limit_s", lambda job: 0.5 if job.address.chain == 0 else 60.0
    )
    source, pool = ListSource(3), ProcessPool(1, "tests.workers.fake:run_chain_zero_deaf")
    work(Dispatcher(source, pool, "w"), lambda: len(source.reported) == 3)
    pool.close()
    assert source.reported[Ticket(0, 1)].ending is Ending.TIMEOUT
    assert source.reported[Ticket(2, 1)] == run_fake(hop_job(chain=2))


def test_a_hop_that_is_slow_is_not_taken_for_hung():
    job = hop_job(n_hops=3, settings={"cpu_seconds": 10.0})
    # Four times the cap and a minute for each of three solves, then five minutes.
    assert wall_limit_s(job) == 3 * (40.0 + 60.0) + 300.0
