"""What only Ray must promise: one test per promise, on one simulated cluster of four nodes.

Clusters that are killed, or refuse us, belong to processes of their own, since Ray lives once per process.
"""

import json
import os
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.workers import fake
from tests.workers.jobs import hop_job
from tests.workers.own_ray_cluster import STORIES
from workers import ray_executor, ray_nodes
from workers.executor import ExecutorError, Inline
from workers.messages import Ending, Ticket
from workers.ray_executor import RayCluster, RayExecutor
from workers.ray_nodes import Versions, own_token

ROOT = Path(__file__).parents[2]


@pytest.fixture
def executor(ray_cluster, request):
    opened = RayExecutor(ray_cluster, getattr(request, "param", "tests.workers.fake:run_fake"))
    yield opened
    opened.close()


def run_all(executor, jobs):
    """Run numbered jobs with a full window; return outcomes by number, and the most that were in flight."""
    waiting, in_flight, most, outcomes = deque(jobs.items()), 0, 0, {}
    deadline = time.monotonic() + 120
    while len(outcomes) < len(jobs) and time.monotonic() < deadline:
        while waiting and in_flight < executor.capacity():
            number, job = waiting.popleft()
            executor.submit(Ticket(number, 1), job)
            in_flight += 1
        most = max(most, in_flight)
        done = executor.finished(1.0)
        in_flight -= len(done)
        outcomes |= {finished.ticket.job_id: fake.opened(finished.outcome) for finished in done}
    return outcomes, most


@pytest.mark.ray
def test_four_nodes_give_the_outcomes_of_the_inline_executor_within_the_window(executor):
    jobs = {number: hop_job(chain=number, n_hops=1 + number % 3) for number in range(40)}
    outcomes, most = run_all(executor, jobs)
    assert outcomes == run_all(Inline(fake.run_fake), jobs)[0]
    assert executor.capacity() == most == 4


def run_noting_its_start(job, stop):
    """Leave a mark, whose place the job carries as its problem, and die."""
    with open(job.problem["starts"], "a") as file:
        file.write("started\n")
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.ray
@pytest.mark.parametrize("executor", ["tests.workers.test_ray:run_noting_its_start"], indirect=True)
def test_a_job_whose_process_was_killed_is_not_tried_again_by_ray(executor, tmp_path):
    executor.submit(Ticket(1, 1), hop_job(problem={"starts": str(tmp_path / "starts")}))
    (finished,) = executor.finished(60.0)
    assert finished.outcome.head.ending is Ending.CRASH and "died" in finished.outcome.head.error
    assert executor.finished(3.0) == []  # Ray's own retry came after 1.0 s
    assert (tmp_path / "starts").read_text() == "started\n"


def run_raising(job, stop):
    """Fail outside of what a runner catches."""
    raise KeyError("nobody catches this")


@pytest.mark.ray
@pytest.mark.parametrize("executor", ["tests.workers.test_ray:run_raising"], indirect=True)
def test_a_runner_that_raises_is_a_crash_with_its_traceback(executor):
    executor.submit(Ticket(1, 1), hop_job())
    outcome = executor.finished(60.0)[0].outcome.head
    assert outcome.ending is Ending.CRASH and "nobody catches this" in outcome.error


@pytest.mark.ray
def test_an_outcome_too_large_for_a_reply_arrives_all_the_same(executor):
    job = hop_job(n_hops=150)
    assert len(ray_nodes.compress(fake.run_fake(job))) > 100_000
    executor.submit(Ticket(1, 1), job)
    assert fake.opened(executor.finished(60.0)[0].outcome) == fake.run_fake(job)


@pytest.mark.ray
def test_nodes_of_another_version_are_refused(ray_cluster, monkeypatch):
    other = Versions("3.99", "0.1", ray_nodes.versions().code)
    monkeypatch.setattr(ray_executor, "versions", lambda: other)
    with pytest.raises(ExecutorError, match=r"expected python 3.99, got 3.*ray 0.1.*the same release"):
        ray_cluster.check()


@pytest.mark.ray
def test_a_node_of_another_version_that_came_later_is_refused(executor, monkeypatch):
    other = ray_nodes.versions()._replace(code="0+other")
    monkeypatch.setattr(ray_executor, "versions", lambda: other)
    executor.submit(Ticket(1, 1), hop_job())
    with pytest.raises(ExecutorError, match=r"expected code 0\+other, got .*the same release"):
        executor.finished(60.0)


@pytest.mark.ray
def test_a_wrong_token_is_refused(simulated_cluster, tmp_path):
    wrong = own_token(tmp_path / "wrong")
    code = "import sys; from pathlib import Path; from workers.ray_executor import RayCluster; "
    code += "RayCluster(sys.argv[1], token=Path(sys.argv[2]))"
    # Ray asks 20 times, a second apart, unless told otherwise.
    said = subprocess.run(
        [sys.executable, "-c", code, simulated_cluster[0], wrong],
        env=os.environ | {"RAY_NUM_REDIS_GET_RETRIES": "2"},
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert said.returncode == 1 and "InvalidAuthToken" in said.stderr
    assert "ExecutorError: ray cluster" in said.stderr and "token, Ray and Python must be" in said.stderr


@pytest.fixture(scope="module")
def stories():
    """Give what happened to clusters that other processes started for themselves, two at a time."""
    with ThreadPoolExecutor(2) as pool:
        return dict(zip(STORIES, pool.map(story, STORIES), strict=True))


def story(name, n_tries=3):
    with tempfile.TemporaryDirectory(prefix="ray-", dir="/tmp") as folder:
        command = [sys.executable, "-m", "tests.workers.own_ray_cluster", name, folder]
        pipe = subprocess.PIPE
        # A group of its own, so that whatever should remain of it can be ended as one.
        process = subprocess.Popen(
            command, cwd=ROOT, stdout=pipe, stderr=pipe, text=True, start_new_session=True
        )
        try:
            printed, errors = process.communicate(timeout=240)
        finally:
            end_group(process.pid)
            process.communicate()
    if process.returncode and "timed out during startup" in errors and n_tries > 1:
        # A node dies when its agents, started as it is, need more than 15 s (ray #65983).
        return story(name, n_tries - 1)
    assert process.returncode == 0, errors
    return json.loads(printed)


def end_group(group):
    try:
        os.killpg(group, signal.SIGKILL)
    except ProcessLookupError:
        return


@pytest.mark.ray
def test_a_cluster_of_ours_has_its_own_token_no_dashboard_and_leaves_signals_alone(stories):
    story = stories["close"]
    assert story["token_mode"] == 0o600 and not story["has_dashboard"] and story["keeps_sigterm"]
    assert story["capacity"] == 1 and story["ending"] in ("feasible", "infeasible")


@pytest.mark.ray
def test_closing_a_cluster_of_ours_leaves_no_process_even_of_a_deaf_job(stories):
    assert stories["close"]["n_processes"] > 3 and stories["close"]["left"] == []


@pytest.mark.ray
@pytest.mark.parametrize("name", ["raylet", "gcs"])
def test_a_killed_process_is_noticed_at_once_and_nothing_of_its_cluster_remains(stories, name):
    # Ray itself says so 20 s later, and never while nothing is asked of a dead raylet.
    assert stories[name]["seconds_until_lost"] < 10
    assert stories[name]["seconds_to_close"] < 60 and stories[name]["left"] == []


@pytest.mark.ray
def test_a_raylet_that_no_longer_answers_is_noticed_and_nothing_of_its_cluster_remains(stories):
    # Asked every second, and twice no answer in 5 s; in service every 5 s and twice 10 s.
    lost_after = stories["frozen"]["seconds_until_lost"]
    assert lost_after is not None and 5 < lost_after < 30
    assert stories["frozen"]["left"] == []


@pytest.mark.parametrize("address", ["auto", "ray://10.0.0.1:10001", "10.0.0.1", "localhost:ray"])
def test_only_local_or_a_host_and_port_is_an_address(address):
    with pytest.raises(ExecutorError, match="ray address: expected local or host:port, got "):
        RayCluster(address)


def test_a_cluster_that_does_not_answer_is_refused():
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        with pytest.raises(ExecutorError, match=r"expected an answer from .*, got .*refused"):
            RayCluster(f"127.0.0.1:{unused.getsockname()[1]}")


def test_a_folder_too_long_for_sockets_is_refused(tmp_path):
    folder = tmp_path / ("long" * 11)
    with pytest.raises(ExecutorError, match=r"at most 43 bytes for sockets, got .*shorter"):
        RayCluster(n_workers=1, token=tmp_path / "token", folder=folder)


def test_workers_are_counted_only_where_we_start_them(tmp_path):
    with pytest.raises(ExecutorError, match="at least 1, got 0"):
        RayCluster(n_workers=0, token=tmp_path / "token")
    with pytest.raises(ExecutorError, match="expected none for a cluster that has its own, got 2"):
        RayCluster("10.0.0.1:6379", n_workers=2)


def test_ray_is_imported_only_where_it_sees_that_it_must_authenticate(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)  # which an import takes as absent
    monkeypatch.delenv("RAY_AUTH_MODE", raising=False)
    with pytest.raises(ExecutorError, match="got an import without token"):
        RayCluster(n_workers=1, token=tmp_path / "token")
    for name in ("RAY_AUTH_TOKEN_PATH", "RAY_AUTH_TOKEN", "RAY_num_workers_soft_limit"):
        monkeypatch.setenv(name, "")
    monkeypatch.setenv("RAY_AUTH_MODE", "token")
    with pytest.raises(ExecutorError, match=r"expected the package, got .*; install it: pip install"):
        RayCluster(n_workers=1, token=tmp_path / "token")


def test_a_token_is_made_once_and_for_the_owner_alone(tmp_path):
    token = own_token(tmp_path / "deep" / "token")
    first = token.read_text()
    assert len(first) == 64 and stat.S_IMODE(token.stat().st_mode) == 0o600
    assert own_token(token).read_text() == first
    assert [path.name for path in token.parent.iterdir()] == ["token"]


def test_a_token_that_others_can_read_is_refused(tmp_path):
    token = own_token(tmp_path / "token")
    token.chmod(0o644)
    with pytest.raises(ExecutorError, match="expected mode 0600, got 0644; chmod 600"):
        own_token(token)
    with pytest.raises(ExecutorError, match="expected a file with the cluster's token"):
        RayCluster("10.0.0.1:6379", token=tmp_path / "missing")
