"""The loop between a source of jobs and an executor, with a source that lives in memory."""

import threading
import time

import pytest

from tests.service.clock import Clock
from tests.workers.fake import opened, run_fake
from tests.workers.jobs import hop_job, worker_info
from workers.dispatcher import Dispatcher, StaleAttemptError
from workers.executor import ExecutorLostError, Inline, ProcessPool
from workers.messages import (
    Claim,
    ClaimAnswer,
    CompleteAnswer,
    CompleteManyAnswer,
    Ended,
    Ending,
    FaultyError,
    HeartbeatAnswer,
    Ticket,
    UnacceptableError,
    UnreachableError,
    sealed,
    wall_limit_s,
)
from workers.retry import Backoff

INFO = worker_info()


class ListSource:
    """Hands out jobs from a list and remembers what came back."""

    def __init__(self, n_jobs, cancelled=(), heartbeat_s=0.02):
        self.waiting = [Claim(job_id=i, attempt=1, job=hop_job(chain=i - 1)) for i in range(1, n_jobs + 1)]
        self.cancelled = cancelled
        self.lost = set()
        self.heartbeat_s = heartbeat_s
        self.reported = {}
        self.beats = []

    def claim(self, request):
        claimed, self.waiting = self.waiting[: request.n_jobs], self.waiting[request.n_jobs :]
        return ClaimAnswer(claims=tuple(claimed), lease_s=30.0, heartbeat_s=self.heartbeat_s)

    def heartbeat(self, request):
        self.beats.append((time.monotonic(), len(request.held)))
        kept = [job for job in request.held if job.job_id not in self.lost]
        return HeartbeatAnswer(
            extended=kept,
            to_cancel=[job for job in kept if job.job_id in self.cancelled],
            not_held=[job for job in request.held if job.job_id in self.lost],
        )

    def complete(self, report):
        assert report.ticket not in self.reported
        self.reported[report.ticket] = opened(report.outcome)
        return CompleteAnswer(**report.ticket._asdict(), state="done")

    def complete_many(self, reports):
        before = dict(self.reported)
        try:
            return CompleteManyAnswer(answers=tuple(map(self.complete, reports)))
        except Exception:
            # All or none.
            self.reported = before
            raise


class DeafSource(ListSource):
    """Refuses every report, as after a lease that was taken over."""

    def complete(self, report):
        raise StaleAttemptError("job: expected to hold it, got a stale report")


class FailingSource(ListSource):
    """Fails at every report a few times before it takes it."""

    def __init__(self, n_jobs, fault, n_faults):
        super().__init__(n_jobs)
        self.fault, self.n_left = fault, dict.fromkeys(range(1, n_jobs + 1), n_faults)

    def complete(self, report):
        self.n_left[report.ticket.job_id] -= 1
        if self.n_left[report.ticket.job_id] >= 0:
            raise self.fault
        return super().complete(report)


def work(dispatcher, is_done, seconds=120.0):
    deadline = time.monotonic() + seconds
    dispatcher.run(lambda: is_done() or time.monotonic() > deadline)


def test_every_job_is_reported_once_with_its_own_outcome():
    source = ListSource(7)
    work(Dispatcher(source, Inline(run_fake), INFO), lambda: len(source.reported) == 7)
    assert source.reported == {Ticket(i, 1): run_fake(hop_job(chain=i - 1)) for i in range(1, 8)}


def test_no_more_is_claimed_than_runs_at_once():
    source, pool = ListSource(9), ProcessPool(2, "tests.workers.fake:run_fake")
    work(Dispatcher(source, pool, INFO), lambda: len(source.reported) == 9)
    pool.close()
    assert len(source.reported) == 9 and max(n for _, n in source.beats) <= 2


def test_a_report_that_is_refused_does_not_stop_the_work():
    source = DeafSource(3)
    work(Dispatcher(source, Inline(run_fake), INFO), lambda: not source.waiting)
    assert source.waiting == []


def test_a_heartbeat_cancels_what_the_source_wants_back():
    source, pool = ListSource(2, cancelled=(1,)), ProcessPool(2, "tests.workers.fake:run_until_stopped")
    dispatcher = Dispatcher(source, pool, INFO)
    work(dispatcher, lambda: bool(source.reported))
    pool.close()
    assert source.reported[Ticket(1, 1)].ending is Ending.CANCELLED


def test_a_cancel_is_heard_of_long_before_the_next_heartbeat():
    source = ListSource(1, heartbeat_s=60.0)
    pool = ProcessPool(1, "tests.workers.fake:run_until_stopped")
    dispatcher = Dispatcher(source, pool, INFO)
    begin = time.monotonic()
    # The first heartbeat comes after 0.25 s, the second after a minute.
    threading.Timer(3.0, lambda: setattr(source, "cancelled", (1,))).start()
    work(dispatcher, lambda: bool(source.reported))
    pool.close()
    assert source.reported[Ticket(1, 1)].ending is Ending.CANCELLED and time.monotonic() - begin < 30.0


def test_what_the_source_gave_to_somebody_else_is_stopped_and_not_reported():
    source, pool = ListSource(2), ProcessPool(1, "tests.workers.fake:run_chain_zero_deaf")
    source.lost.add(1)
    dispatcher = Dispatcher(source, pool, INFO)
    work(dispatcher, lambda: Ticket(2, 1) in source.reported)
    pool.close()
    assert list(source.reported) == [Ticket(2, 1)] and dispatcher.held() == []


def test_a_solve_in_the_dispatchers_own_thread_does_not_delay_heartbeats():
    source, deadline = ListSource(1), time.monotonic() + 60.0

    def run_until_beaten(job, stop):
        while len(source.beats) < 2 and time.monotonic() < deadline:
            time.sleep(0.01)
        return run_fake(job, stop)

    work(Dispatcher(source, Inline(run_until_beaten), INFO), lambda: len(source.reported) == 1)
    assert [n for _, n in source.beats[:2]] == [1, 1]


@pytest.mark.parametrize("fault", [UnreachableError("no answer"), FaultyError("500")])
def test_a_report_without_an_answer_is_sent_again(fault):
    source = FailingSource(3, fault, n_faults=2)
    work(Dispatcher(source, Inline(run_fake), INFO), lambda: len(source.reported) == 3)
    assert source.reported == {Ticket(i, 1): run_fake(hop_job(chain=i - 1)) for i in (1, 2, 3)}


def test_a_report_that_is_never_taken_is_replaced_by_the_reason():
    source = FailingSource(2, UnacceptableError("body: expected less"), n_faults=1)
    work(Dispatcher(source, Inline(run_fake), INFO), lambda: len(source.reported) == 2)
    assert [outcome.error for outcome in source.reported.values()] == ["report: body: expected less"] * 2


def test_jobs_that_are_lost_with_their_executor_are_reported_before_the_end():
    class Lost(Inline):
        def finished(self, timeout):
            raise ExecutorLostError("ray cluster: expected an answer, got none")

    source = ListSource(1)
    with pytest.raises(ExecutorLostError):
        Dispatcher(source, Lost(run_fake), INFO).run(lambda: False)
    assert source.reported[Ticket(1, 1)].ending is Ending.LOST


def test_waits_double_up_to_a_limit_and_begin_anew_after_a_success():
    clock = Clock(0.0)
    backoff = Backoff(1.0, 8.0, clock)
    waits = [backoff.failed() for _ in range(6)]
    # Each is cut at random by up to a half.
    assert all(limit / 2 <= wait <= limit for wait, limit in zip(waits, (1, 2, 4, 8, 8, 8), strict=True))
    assert not backoff.is_due() and backoff.failed(at_least_s=60.0) == 60.0
    backoff.succeeded()
    assert backoff.is_due() and backoff.failed() <= 1.0


def test_stopping_hands_in_what_runs():
    source, pool, stop = (
        ListSource(2),
        ProcessPool(2, "tests.workers.fake:run_until_stopped"),
        threading.Event(),
    )
    threading.Timer(0.5, stop.set).start()
    Dispatcher(source, pool, INFO).run(stop.is_set)
    pool.close()
    assert [outcome.ending for outcome in source.reported.values()] == [Ending.CANCELLED] * 2


def test_stopping_kills_what_does_not_listen(monkeypatch):
    monkeypatch.setattr("workers.dispatcher.GRACE_S", 0.3)
    source, pool, stop = ListSource(1), ProcessPool(1, "tests.workers.fake:run_deaf"), threading.Event()
    threading.Timer(0.3, stop.set).start()
    Dispatcher(source, pool, INFO).run(stop.is_set)
    pool.close()
    assert source.reported[Ticket(1, 1)].ending is Ending.CANCELLED


def test_a_job_that_hangs_is_killed_and_its_slot_works_on(monkeypatch):
    monkeypatch.setattr(
        "workers.dispatcher.wall_limit_s", lambda job: 0.5 if job.address.chain == 0 else 60.0
    )
    source, pool = ListSource(3), ProcessPool(1, "tests.workers.fake:run_chain_zero_deaf")
    work(Dispatcher(source, pool, INFO), lambda: len(source.reported) == 3)
    pool.close()
    assert source.reported[Ticket(1, 1)].ending is Ending.TIMEOUT
    assert source.reported[Ticket(2, 1)] == run_fake(hop_job(chain=1))


def test_a_hop_that_is_slow_is_not_taken_for_hung():
    job = hop_job(n_hops=3, settings={"cpu_seconds": 10.0})
    # Four times the cap and a minute for each of three solves, then five minutes.
    assert wall_limit_s(job) == 3 * (40.0 + 60.0) + 300.0


class PickySource(ListSource):
    """Has given one job to somebody else."""

    def complete(self, report):
        if report.ticket.job_id == 2:
            raise StaleAttemptError("job: expected to hold it, got a stale report")
        return super().complete(report)


@pytest.mark.parametrize(("kind", "expected"), [(ListSource, {1, 2, 3}), (PickySource, {1, 3})])
def test_what_ended_meanwhile_is_reported_together_and_one_by_one_where_one_is_refused(kind, expected):
    source = kind(3)
    dispatcher = Dispatcher(source, Inline(run_fake), INFO)
    dispatcher._unreported = {Ticket(i, 1): sealed(Ended, run_fake(hop_job(chain=i - 1))) for i in (1, 2, 3)}
    dispatcher._report()
    assert {ticket.job_id for ticket in source.reported} == expected and dispatcher.held() == []
