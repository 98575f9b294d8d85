"""Dispatchers as processes of their own, on loopback: several at once, killed, refused; no solver runs."""

import errno
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from service.client import Client, ClientError
from service.coordinator import Coordinator, WorkerSetup
from service.coordinator.supervisor import Supervisor
from service.db.errors import WriteError
from service.scheduler import LeaseSettings
from service.schemas.identity import Role
from service.store.store import Store
from tests.service.campaigns import content, dispatcher_pid, finish, spec_fields, submitted
from tests.service.databases import rows
from tests.service.fake_coastarc import LEASE
from tests.workers.jobs import worker_info
from workers.client import Api, HttpSource
from workers.dispatch import CANNOT_WORK, DispatchOrder, ExecutorKind
from workers.messages import ClaimRequest, RefusedError

SLOW = "tests.workers.fake:run_slowly"
#: Long enough for a heartbeat on a busy machine, short enough to be waited for.
LEASES = LeaseSettings(lease_s=8.0, heartbeat_s=1.0, reap_s=0.5)


def wait_for(condition, seconds=240.0):
    deadline = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < deadline
        time.sleep(0.1)
    return found


def undisturbed(folder, guesses):
    folder.mkdir()
    with Store(folder) as store:
        submitted(store, spec_fields(guesses))
        finish(store)
        return content(store)


@pytest.fixture
def start(tmp_path):
    """Return a function that starts a command; none of them outlives the test."""
    started = []

    def begin(*arguments):
        log = tmp_path / f"{arguments[0]}-{len(started)}.log"
        command = [sys.executable, "-m", "tests.service.fake_coastarc", "run_slowly", *map(str, arguments)]
        environment = dict(os.environ) | {LEASE: str(LEASES.lease_s)}
        with log.open("w") as file:
            started.append(subprocess.Popen(command, stdout=file, stderr=file, env=environment))
        return started[-1]

    yield begin
    for process in started:
        process.kill()
        process.wait()
    for log in sorted(tmp_path.glob("*.log")):
        sys.stdout.write(f"--- {log.name}\n{log.read_text()}")


@pytest.fixture
def dispatch(start):
    return lambda url, *arguments: start("dispatch", "--url", url, "--runner", SLOW, *arguments)


def is_done(store, campaign_id):
    return store.campaign(campaign_id).state == "done"


def n_done(store):
    return len(store.jobs(None, None, "done", 200).items)


@pytest.mark.slow
def test_two_dispatchers_find_what_one_finds_and_hand_in_what_they_have_at_the_end(tmp_path, dispatch):
    expected = undisturbed(tmp_path / "one", guesses=48)
    with Coordinator(tmp_path / "two", leases=LEASES) as coordinator:
        store = coordinator.store
        pool = dispatch(coordinator.url, "--workers", 1)
        inline = dispatch(coordinator.url, "--executor", "inline")
        wait_for(lambda: len(store.workers().items) == 2)
        campaign_id = submitted(store, spec_fields(48))
        wait_for(lambda: is_done(store, campaign_id))
        for process in (pool, inline):
            process.send_signal(signal.SIGTERM)
        assert [process.wait(timeout=60) for process in (pool, inline)] == [0, 0]
        assert len({job.worker for job in store.jobs(None, None, "done", 200).items}) == 2
        assert content(store) == expected


@pytest.fixture
def guarded(tmp_path, monkeypatch):
    """A coordinator that asks everybody for a token."""
    with Store(tmp_path) as store:
        token = store.identities.create("me", Role.ADMIN, 1.0).token
    monkeypatch.setenv("COASTARC_AUTH", "required")
    with Coordinator(tmp_path, leases=LEASES) as coordinator:
        yield coordinator, token


@pytest.mark.slow
def test_a_killed_dispatcher_is_replaced_and_its_jobs_run_again_after_their_leases(tmp_path, guarded):
    coordinator, _ = guarded
    expected = undisturbed(tmp_path / "undisturbed", guesses=24)
    campaign_id = submitted(coordinator.store, spec_fields(24))
    coordinator.work(WorkerSetup(2, ExecutorKind.PROCESS, SLOW), campaign_id)
    wait_for(lambda: n_done(coordinator.store) >= 3)
    pid = dispatcher_pid(coordinator)
    # Handed over by a pipe: no list of processes and no environment shows the token.
    shown = Path(f"/proc/{pid}/cmdline").read_bytes() + Path(f"/proc/{pid}/environ").read_bytes()
    assert b"coastarc_" not in shown
    os.kill(pid, signal.SIGKILL)
    wait_for(lambda: is_done(coordinator.store, campaign_id))
    assert dispatcher_pid(coordinator) != pid
    coordinator.raise_fault()
    assert content(coordinator.store) == expected


def test_an_admin_who_revokes_the_token_of_the_own_dispatcher_does_no_harm(tmp_path, guarded):
    coordinator, _ = guarded
    store = coordinator.store
    expected = undisturbed(tmp_path / "undisturbed", guesses=24)
    campaign_id = submitted(store, spec_fields(24))
    coordinator.work(WorkerSetup(2, ExecutorKind.PROCESS, SLOW), campaign_id)
    wait_for(lambda: n_done(store) >= 2)
    pid = dispatcher_pid(coordinator)
    (own,) = [token.name for token in store.identities.tokens() if token.name != "me"]
    store.identities.revoke(own)
    wait_for(lambda: is_done(store, campaign_id))
    coordinator.raise_fault()
    # The same process, with another token; what it worked on meanwhile is its own still.
    assert dispatcher_pid(coordinator) == pid and content(store) == expected
    assert rows(store, "SELECT count(*) FROM attempt WHERE attempt > 1 OR ending = 'lost'") == [(0,)]
    assert rows(store, "SELECT count(*) FROM audit WHERE status = 401")[0][0] < 10


@pytest.mark.slow
def test_a_killed_coordinator_is_started_again_and_nothing_is_lost(tmp_path, start, dispatch):
    expected = undisturbed(tmp_path / "undisturbed", guesses=32)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    url = f"http://127.0.0.1:{port}"
    serve = ("serve", "--data", tmp_path / "killed", "--port", port, "--workers", 1)
    first, elsewhere = start(*serve), dispatch(url, "--workers", 1)
    with Client(url) as client:
        wait_for(lambda: answer(lambda: len(client.workers().items)) == 2)
        campaign_id = client.submit(spec_fields(32))[0].id
        wait_for(lambda: len(client.jobs(campaign_id, None, "done", 200).items) >= 3)
        first.kill()
        second = start(*serve)
        wait_for(lambda: answer(lambda: client.campaign(campaign_id).state) == "done")
    for process in (elsewhere, second):
        process.terminate()
        assert process.wait(timeout=60) == 0
    with Store(tmp_path / "killed", read_only=True) as store:
        assert content(store) == expected


def answer(ask):
    """Return what a coordinator says, or None while nobody is there."""
    try:
        return ask()
    except ClientError as error:
        assert error.status is None, error
        return None


def test_another_version_and_a_token_for_something_else_are_refused_with_the_reason(guarded):
    coordinator, _ = guarded

    def claim(role, **changes):
        token = coordinator.store.identities.create(f"a {role}", role, 1.0).token if role else None
        # The first answer of a coordinator takes long where processors are busy.
        with Api(coordinator.url, token, timeout_s=120.0) as api:
            HttpSource(api).claim(ClaimRequest(worker=worker_info(**changes), n_jobs=1))

    with pytest.raises(
        RefusedError, match=r"got 0\.0\.1\+other on Python .* install the coordinator's version"
    ):
        claim(Role.WORKER, code_version="0.0.1+other")
    with pytest.raises(RefusedError, match="expected role worker, got viewer"):
        claim(Role.VIEWER)
    with pytest.raises(RefusedError, match="expected Bearer and a token, got none"):
        claim(None)


def test_a_dispatcher_that_can_never_work_is_not_started_again():
    supervisor = Supervisor(lambda: DispatchOrder(url="ftp://nowhere", executor=ExecutorKind.INLINE))
    supervisor.start()
    assert wait_for(lambda: supervisor.fault).startswith("url: expected one as http://host:8741, got ftp://")
    supervisor.stop()


def test_a_dispatcher_that_cannot_be_started_is_tried_again_and_said_once(caplog):
    faults = [WriteError("archive x: expected room to write, got none; free some space")] * 2
    faults += [OSError(errno.ENOMEM, "Cannot allocate memory")]

    def order():
        if faults:
            raise faults.pop(0)
        return DispatchOrder(url="ftp://nowhere", executor=ExecutorKind.INLINE)

    supervisor = Supervisor(order)
    supervisor.start()
    wait_for(lambda: supervisor.trouble)
    # Nothing of the archive's place, since anybody may read it.
    assert supervisor.trouble == "an archive that takes no write" and supervisor.fault is None
    wait_for(lambda: supervisor.fault)
    assert supervisor.trouble is None
    supervisor.stop()
    said = [line for line in caplog.messages if "expected to start" in line]
    assert [("expected room to write" in line, "Cannot allocate" in line) for line in said] == [
        (True, False),
        (False, True),
    ]


def test_a_dispatcher_whose_coordinator_is_gone_ends_by_itself():
    order = DispatchOrder(url="http://127.0.0.1:9", n_workers=1, runner=SLOW).written()
    child = subprocess.Popen(
        [sys.executable, "-m", "workers.dispatch"],
        stdin=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    child.stdin.write(order + "\n")
    child.stdin.flush()
    with pytest.raises(subprocess.TimeoutExpired):
        child.wait(timeout=3)
    child.stdin.close()
    assert child.wait(timeout=60) in (0, CANNOT_WORK)
