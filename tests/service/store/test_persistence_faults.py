"""Faults of the archive under workers and users: before a commit, after it, and on a full disk."""

import errno
import io
import os
import resource
import subprocess
import threading
import time

import httpx
import psutil
import pytest
from rich.console import Console

from core.errors import UserError
from service.cli import run as cli_run
from service.client import Client, ClientError
from service.coordinator import Coordinator
from service.db.engine import Moment
from service.scheduler import LeaseSettings
from service.store.store import Store
from tests.service.by_hand import worker_info
from tests.service.campaigns import content, finish, spec_fields, submitted
from tests.service.coordinator.test_dispatch import start, undisturbed, wait_for  # noqa: F401 - a fixture
from tests.service.databases import rows
from tests.service.db.test_engine import limit_pages
from tests.workers.fake import run_fake
from workers.client import Api, HttpSource
from workers.dispatcher import Dispatcher
from workers.executor import Inline
from workers.messages import ClaimAnswer, ClaimRequest, CompleteRequest

MOMENTS = pytest.mark.parametrize("moment", list(Moment))


class FailingWrites:
    """A coordinator as a source of jobs, whose archive fails the first time that it is asked for the same."""

    def __init__(self, source, database, verb, moment, n_faults):
        self._source, self._database = source, database
        self._verb, self._moment = verb, moment
        self.n_faults_left = n_faults
        self._asked = set()

    def claim(self, request):
        return self._ask("claim", request, time.monotonic())

    def complete(self, report):
        return self._ask("complete", report, report.ticket)

    def heartbeat(self, request):
        return self._source.heartbeat(request)

    def _ask(self, verb, request, what):
        if verb == self._verb and what not in self._asked and self.n_faults_left:
            self._asked.add(what)
            self.n_faults_left -= 1
            fail_once(self._database, self._moment)
        return getattr(self._source, verb)(request)


def fail_once(database, moment):
    def hook(reached):
        if reached is moment and threading.current_thread().name != "reaper":
            database.hook = lambda _: None
            raise ZeroDivisionError("the process could have died here")

    database.hook = hook


def worked_off(coordinator, verb, moment, n_faults):
    """Work on everything over HTTP while the archive fails so many times; return how often it did not."""
    store = coordinator.store
    with Api(coordinator.url, timeout_s=120.0) as api:
        source = FailingWrites(HttpSource(api), store._database, verb, moment, n_faults)
        dispatcher = Dispatcher(source, Inline(run_fake), worker_info("by hand", slots=1))
        wait_for(lambda: not dispatcher.step() and store.campaigns()[0].state == "done")
        return source.n_faults_left


@MOMENTS
def test_a_report_over_which_the_archive_fails_is_repeated_and_counts_once(tmp_path, moment):
    expected = undisturbed(tmp_path / "undisturbed", guesses=12)
    with Coordinator(tmp_path / "faulty", leases=LeaseSettings(lease_s=120.0)) as coordinator:
        submitted(coordinator.store, spec_fields(12))
        assert worked_off(coordinator, "complete", moment, n_faults=8) == 0
        assert content(coordinator.store) == expected
        # By its first attempt: the second report found the job either still held or done by the first one.
        attempts = rows(coordinator.store, "SELECT job_id, attempt, next_state FROM attempt ORDER BY job_id")
        assert {row[1:] for row in attempts} == {(1, "done")}
        assert len(attempts) == coordinator.store.campaigns()[0].n_jobs


@MOMENTS
def test_a_claim_over_which_the_archive_fails_loses_no_job(tmp_path, moment):
    expected = undisturbed(tmp_path / "undisturbed", guesses=12)
    leases = LeaseSettings(lease_s=2.0, heartbeat_s=0.5, reap_s=0.25)
    with Coordinator(tmp_path / "faulty", leases=leases) as coordinator:
        submitted(coordinator.store, spec_fields(12))
        assert worked_off(coordinator, "claim", moment, n_faults=2) == 0
        assert content(coordinator.store) == expected
        n_lost = rows(coordinator.store, "SELECT count(*) FROM attempt WHERE ending = 'lost'")[0][0]
        # Handed out to somebody who was not told: the lease brings it back.
        assert n_lost >= 2 if moment is Moment.AFTER_COMMIT else True


@MOMENTS
@pytest.mark.parametrize("key", [None, "mine"])
def test_a_submission_over_which_the_archive_fails_is_repeated_and_is_one_campaign(tmp_path, moment, key):
    with Coordinator(tmp_path) as coordinator, Client(coordinator.url) as client:
        fail_once(coordinator.store._database, moment)
        with pytest.raises(ClientError, match="got 500, the service failed"):
            client.submit(spec_fields(), key)
        is_stored = moment is Moment.AFTER_COMMIT
        assert len(client.campaigns()) == is_stored
        campaign, is_new = client.submit(spec_fields(), key)
        assert is_new is not is_stored and [item.id for item in client.campaigns()] == [campaign.id]
        assert rows(coordinator.store, "SELECT count(*) FROM job") == [(4,)]


@pytest.fixture
def full(tmp_path):
    """Give a coordinator with a campaign, and functions to ask it and to fill its disk."""
    with Coordinator(tmp_path, leases=LeaseSettings(lease_s=120.0)) as coordinator:
        fields = spec_fields(400)
        fields["search"][0]["hops"] = 20
        submitted(coordinator.store, fields)
        with httpx.Client(base_url=coordinator.url + "/api/v1", timeout=120.0, trust_env=False) as http:

            def ask(path, message):
                body = message if isinstance(message, dict) else message.model_dump(mode="json")
                return http.post(path, json=body)

            yield coordinator.store, ask


def state_of(store):
    tables = ("campaign", "search", "job", "attempt", "solve", "solution", "seed_link", "event", "submission")
    return {table: rows(store, f"SELECT * FROM {table}") for table in tables}


def refused_while_full(store, ask, path, message):
    """Ask on a full disk, and again once there is room; return the answer then."""
    before = state_of(store)
    limit_pages(store._database, 0)
    answer = ask(path, message)
    assert answer.status_code == 503 and answer.headers["Retry-After"] == "5"
    assert "what was stored before is kept" in answer.json()["detail"]
    assert state_of(store) == before and store.campaigns()
    limit_pages(store._database, None)
    return ask(path, message)


def claim_of(n_jobs):
    # A long name, so that writing it down needs room.
    return ClaimRequest(worker=worker_info("w" * 200), n_jobs=n_jobs)


def test_a_claim_on_a_full_disk_hands_out_nothing_until_there_is_room(full):
    taken = refused_while_full(*full, "/jobs/claim", claim_of(1000))
    assert taken.status_code == 200 and len(ClaimAnswer.model_validate(taken.json()).claims) == 20


def test_a_report_on_a_full_disk_is_taken_once_there_is_room(full):
    store, ask = full
    claim = store.claim("w", 1)[0]
    report = CompleteRequest(job_id=claim.job_id, attempt=claim.attempt, outcome=run_fake(claim.job))
    assert refused_while_full(store, ask, "/jobs/complete", report).json()["state"] == "done"
    assert rows(store, "SELECT count(*) FROM solve") == [(20,)]


def test_a_submission_on_a_full_disk_is_taken_once_there_is_room(full):
    searches = [{"id": f"s{number}", "strategy": "S(0)", "guesses": 40} for number in range(60)]
    fields = spec_fields(search=searches, campaign={"name": "large", "rng_seed": 8})
    # Some of its jobs are planned after the answer.
    assert refused_while_full(*full, "/campaigns", fields).status_code == 202


def test_a_service_whose_disk_is_full_answers_and_goes_on_by_itself_once_there_is_room(tmp_path, start):  # noqa: F811
    expected = undisturbed(tmp_path / "undisturbed", guesses=20)
    served = start("serve", "--data", tmp_path / "full", "--port", 0, "--workers", 1)
    log = tmp_path / "serve-0.log"
    url = wait_for(lambda: log.read_text().partition("Live page: ")[2].partition("\n")[0])
    with Client(url) as client:
        campaign_id = client.submit(spec_fields(20))[0].id
        wait_for(lambda: len(client.jobs(campaign_id, None, "done", 200).items) >= 3)
        service = psutil.Process(served.pid)
        service.rlimit(resource.RLIMIT_FSIZE, (1, resource.RLIM_INFINITY))
        wait_for(lambda: httpx.get(url + "/readyz", trust_env=False, timeout=60).status_code == 503)
        n_done = len(client.jobs(campaign_id, None, "done", 200).items)
        time.sleep(3.0)  # longer than any job takes
        assert len(client.jobs(campaign_id, None, "done", 200).items) == n_done < client.campaigns()[0].n_jobs
        service.rlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        wait_for(lambda: client.campaign(campaign_id).state == "done")
    served.terminate()
    assert served.wait(timeout=60) == 0
    with Store(tmp_path / "full", read_only=True) as store:
        assert content(store) == expected


def limit_files(process, most):
    """Let no file of a process, nor of those that it starts, grow beyond so many bytes, as on a full disk."""
    process.rlimit(resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))


def own_dispatcher(service):
    return [child for child in service.children() if "workers.dispatch" in " ".join(child.cmdline())]


@pytest.mark.slow
def test_a_dispatcher_that_dies_on_a_full_disk_is_back_once_there_is_room(tmp_path, start):  # noqa: F811
    expected = undisturbed(tmp_path / "undisturbed", guesses=20)
    served = start("serve", "--data", tmp_path / "full", "--port", 0, "--workers", 1)
    log = tmp_path / "serve-0.log"
    url = wait_for(lambda: log.read_text().partition("Live page: ")[2].partition("\n")[0])
    with Client(url) as client:
        campaign_id = client.submit(spec_fields(20))[0].id
        wait_for(lambda: len(client.jobs(campaign_id, None, "done", 200).items) >= 3)
        service = psutil.Process(served.pid)
        limit_files(service, 1)
        own_dispatcher(service)[0].kill()

        def checks():
            return httpx.get(url + "/readyz", trust_env=False, timeout=60).json()["checks"]

        said = wait_for(lambda: "own" in checks()["dispatcher"] and checks()["dispatcher"])
        assert "cannot start its own, got an archive that takes no write; it tries again" in said
        assert served.poll() is None
        limit_files(service, resource.RLIM_INFINITY)
        wait_for(lambda: client.campaign(campaign_id).state == "done")
    served.terminate()
    assert served.wait(timeout=60) == 0
    with Store(tmp_path / "full", read_only=True) as store:
        assert content(store) == expected


@pytest.fixture
def small_disk(tmp_path):
    """Give the folder of a disk of 900 kB, and a function that leaves so many bytes free on it."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=900k", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("only root may mount a disk that is full")

    def leave(n_bytes):
        with (folder / "filled").open("wb") as file:
            file.write(bytes(os.statvfs(folder).f_bavail * os.statvfs(folder).f_bsize - n_bytes))

    yield folder, leave
    subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.mark.parametrize("n_bytes", [0, 8192])
@pytest.mark.parametrize("is_new", [True, False])
def test_a_start_on_a_full_disk_says_so_in_one_line(small_disk, is_new, n_bytes):
    disk, leave = small_disk
    if not is_new:
        with Store(disk) as store:
            submitted(store, spec_fields(4))
    leave(n_bytes)
    room = r"expected room to write, got .*(No space|disk).*; free some space and start again"
    with pytest.raises(UserError, match=room), Coordinator(disk):
        pass


class FullFile(io.StringIO):
    """A file on a disk that has room at the second attempt."""

    is_full = True

    def write(self, text):
        if self.is_full:
            self.is_full = False
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(text)


def test_a_run_whose_log_is_on_a_full_disk_goes_on_to_its_end(tmp_path, monkeypatch):
    monkeypatch.setattr(cli_run, "LOG_PERIOD_S", 0.0)
    file = FullFile()
    with Coordinator(tmp_path) as coordinator:
        campaign_id = submitted(coordinator.store, spec_fields(4))
        worker = threading.Timer(1.5, finish, [coordinator.store])
        worker.start()
        cli_run._follow(Console(file=file), coordinator, campaign_id)
        worker.join()
        assert coordinator.store.campaign_state(campaign_id) == "done" and "solves" in file.getvalue()
