"""What a dispatcher does with finished outcomes while nobody takes them: it keeps them on disk, for hours."""

import pytest

from tests.workers.fake import opened, run_fake
from tests.workers.jobs import hop_job, worker_info
from tests.workers.test_dispatcher import FailingSource, ListSource
from workers.dispatcher import MOST_FAULTS, Dispatcher, Outbox
from workers.executor import Inline
from workers.messages import (
    CompleteAnswer,
    Ended,
    Ending,
    FaultyError,
    Finished,
    HeartbeatAnswer,
    HeldJob,
    RefusedError,
    Ticket,
    UnacceptableError,
    UnreachableError,
    job_digest,
    sealed,
)
from workers.retry import Backoff

#: More often than a report is tried before it counts as the report's fault.
MANY = 5 * MOST_FAULTS


@pytest.fixture
def outbox(tmp_path):
    return Outbox(tmp_path / "outbox")


def files(outbox):
    return sorted(str(path.relative_to(outbox.folder)) for path in outbox.folder.rglob("*.json"))


def dispatcher_on(source, outbox=None, runner=run_fake):
    made = Dispatcher(source, Inline(runner), worker_info(), outbox=outbox)
    made._line = Backoff(1e-6, 1e-6)
    return made


class AwaySource(ListSource):
    """Hands out jobs, and then answers nothing at all for a while."""

    def __init__(self, n_jobs, fault, n_faults):
        super().__init__(n_jobs)
        self.fault, self.n_faults = fault, n_faults

    def complete(self, report):
        self.n_faults -= 1
        if self.n_faults >= 0:
            raise self.fault
        return super().complete(report)


@pytest.mark.parametrize("fault", [FaultyError("500", status=500), UnreachableError("503", status=503)])
def test_an_outcome_is_kept_however_long_the_service_fails_over_everything(fault, outbox, caplog):
    source = AwaySource(1, fault, MANY)
    dispatcher = dispatcher_on(source, outbox)
    while source.n_faults > 0:
        dispatcher.step()
        assert files(outbox) == ([] if source.n_faults == MANY else ["job-1-attempt-1.json"])
    while dispatcher.step():
        pass
    assert source.reported == {Ticket(1, 1): run_fake(hop_job(chain=0))} and files(outbox) == []
    said = [record.getMessage() for record in caplog.records]
    # When it begins to wait and where, that it is handed in, and that the coordinator works again.
    assert len(said) == 3 and "that wait to be handed in: 1, 1 of them in" in said[0]
    assert said[1] == "job 1: the outcome that waited is handed in" and "works again" in said[2]


def test_a_report_over_which_a_service_fails_that_takes_others_is_put_aside_and_told(outbox, caplog):
    source = FailingSource(3, FaultyError("500", status=500), n_faults=0)
    source.n_left[1] = 10**6
    dispatcher = dispatcher_on(source, outbox)
    dispatcher._unreported = {Ticket(i, 1): sealed(Ended, run_fake(hop_job(chain=i - 1))) for i in (1, 2)}
    source.waiting = []
    while files(outbox) != ["refused/job-1-attempt-1.json"]:
        dispatcher._report()
        # Between two failures the service takes a heartbeat, so it is well.
        dispatcher._heartbeat._answers.put(HeartbeatAnswer(extended=(HeldJob(job_id=1, attempt=1),)))
        dispatcher._obey()
    # The other was not held up by it.
    assert source.reported == {Ticket(2, 1): run_fake(hop_job(chain=1))}
    # Ten failures with a sign of health before each, and one beside the other report.
    assert 10**6 - source.n_left[1] >= MOST_FAULTS
    (aside,) = Outbox(outbox.folder / "refused").reports()
    assert opened(aside.outcome) == run_fake(hop_job(chain=0))
    source.n_left[1] = 0
    while dispatcher._unreported:
        dispatcher._report()
    assert source.reported[Ticket(1, 1)].ending is Ending.ERROR
    assert "refused/job-1-attempt-1.json" in source.reported[Ticket(1, 1)].error
    assert "its outcome is kept in" in caplog.text


def test_what_a_dispatcher_could_not_hand_in_is_handed_in_first_by_the_next(outbox):
    away = AwaySource(1, UnreachableError("coordinator: expected one, got none"), 10**6)
    first = dispatcher_on(away, outbox)
    first.run(lambda: bool(away.n_faults < 10**6 - 3))
    assert files(outbox) == ["job-1-attempt-1.json"]

    class Strict(ListSource):
        def claim(self, request):
            assert Ticket(1, 1) in self.reported
            return super().claim(request)

    source = Strict(0)
    second = dispatcher_on(source, outbox)
    assert second.held() == [Ticket(1, 1)]
    second.step()
    second.step()
    assert source.reported == {Ticket(1, 1): run_fake(hop_job(chain=0))} and files(outbox) == []


def test_a_report_from_a_file_says_which_job_it_is_of(outbox):
    asked = []

    class Curious(ListSource):
        def complete(self, report):
            asked.append(report.job_digest)
            return super().complete(report)

    away = AwaySource(1, UnreachableError("no answer"), 1)
    dispatcher = dispatcher_on(away, outbox)
    dispatcher.step()
    dispatcher_on(Curious(0), outbox).step()
    assert asked == [job_digest(hop_job(chain=0))]


def test_a_dispatcher_that_is_refused_leaves_what_it_has_in_its_outbox(outbox):
    class Refusing(ListSource):
        def complete(self, report):
            raise RefusedError("token: expected one in force, got none")

    with pytest.raises(RefusedError):
        dispatcher_on(Refusing(1), outbox).run(lambda: False)
    assert files(outbox) == ["job-1-attempt-1.json"]


def test_an_outcome_of_another_archive_is_put_aside_and_no_job_of_this_one_gets_an_error(outbox):
    dispatcher_on(AwaySource(1, UnreachableError("no answer"), 1), outbox).step()

    class Other(ListSource):
        def complete(self, report):
            raise UnacceptableError("job 1: expected the outcome of this job, got that of another archive's")

    dispatcher = dispatcher_on(Other(0), outbox)
    assert not dispatcher.step() and files(outbox) == ["refused/job-1-attempt-1.json"]


def test_an_outcome_for_a_job_that_was_given_up_is_put_aside(outbox):
    dispatcher_on(AwaySource(1, UnreachableError("no answer"), 1), outbox).step()

    class Dead(ListSource):
        def complete(self, report):
            return CompleteAnswer(**report.ticket._asdict(), state="dead")

    assert not dispatcher_on(Dead(0), outbox).step()
    assert files(outbox) == ["refused/job-1-attempt-1.json"]


def test_an_outcome_is_offered_even_when_its_lease_has_run_out(outbox):
    source = ListSource(0)
    dispatcher = dispatcher_on(source, outbox)
    dispatcher._unreported = {Ticket(1, 1): sealed(Ended, run_fake(hop_job()))}
    dispatcher._heartbeat._answers.put(HeartbeatAnswer(not_held=(HeldJob(job_id=1, attempt=1),)))
    dispatcher.step()
    assert list(source.reported) == [Ticket(1, 1)]


def test_a_disk_that_takes_no_file_keeps_nobody_from_waiting_in_memory(tmp_path, caplog):
    (tmp_path / "outbox").write_text("in the way")
    source = AwaySource(1, UnreachableError("no answer"), 3)
    dispatcher = dispatcher_on(source, Outbox(tmp_path / "outbox"))
    for _ in range(6):
        dispatcher.step()
    assert list(source.reported) == [Ticket(1, 1)] and "expected room for" in caplog.text


def test_a_file_that_is_no_report_is_left_and_told_of(outbox, caplog):
    outbox.folder.mkdir()
    (outbox.folder / "job-1-attempt-1.json").write_text("{")
    assert dispatcher_on(ListSource(0), outbox).held() == []
    assert files(outbox) == ["job-1-attempt-1.json"] and "left where it is" in caplog.text


def test_what_waits_is_for_its_owner_alone(outbox):
    report = Finished(Ticket(1, 1), sealed(Ended, run_fake(hop_job())))
    outbox.put(report)
    outbox.set_aside(report)
    modes = {path.is_dir(): path.stat().st_mode & 0o777 for path in outbox.folder.rglob("*")}
    assert modes == {True: 0o700, False: 0o600}
