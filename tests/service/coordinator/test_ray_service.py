"""Ray behind the command line: its cluster is lost, stopped, killed or absent; no solver runs."""

import os
import signal
import socket
import stat
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from service.client import Client, ClientError
from tests.service.campaigns import spec_fields
from tests.service.coordinator.test_dispatch import LEASES, wait_for
from tests.service.fake_coastarc import LEASE
from workers.process_tree import kill

ROOT = Path(__file__).parents[3]
#: What the project promises [s].
BACK_S, STOPPED_S = 90.0, 15.0


class Served:
    """The command `coastarc serve --executor ray`, and what is seen of it from outside."""

    def __init__(self, folder, runner):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.data = folder / "data"
        command = [sys.executable, "-P", "-m", "tests.service.fake_coastarc", runner, "serve"]
        command += ["--data", self.data, "--port", port, "--executor", "ray", "--workers", 2]
        environment = dict(os.environ) | {LEASE: str(LEASES.lease_s), "PYTHONPATH": str(ROOT)}
        self.log = (folder / "log").open("w+")
        self.process = subprocess.Popen(
            list(map(str, command)), cwd=beside_decoys(folder), env=environment, stderr=self.log
        )
        self.client = Client(f"http://127.0.0.1:{port}")

    def workers(self):
        """Return the names of those who ever worked, or None while nobody answers."""
        try:
            return {worker.name for worker in self.client.workers().items}
        except ClientError:
            return None

    def done_by(self, workers):
        """Return the newest job that none of these workers did."""
        return next(
            (job for job in self.client.jobs(1, None, "done", 200).items if job.worker not in workers), None
        )

    def family(self):
        return psutil.Process(self.process.pid).children(recursive=True)

    def close(self):
        if self.process.poll() is None:
            kill(self.family())
        self.process.kill()
        self.process.wait()
        self.client.__exit__(None, None, None)
        self.log.close()


def beside_decoys(folder):
    """Return a folder in which none of our packages must be looked for."""
    for name in ("core", "workers", "service"):
        (folder / "here" / name).mkdir(parents=True)
        (folder / "here" / name / "__init__.py").write_text("raise RuntimeError('of another project')")
    return folder / "here"


@pytest.fixture
def serve(tmp_path):
    """Return a function that starts the command; nothing of it outlives the test."""
    opened = []

    def begin(runner):
        opened.append(Served(tmp_path, runner))
        wait_for(lambda: opened[-1].workers() is not None)
        return opened[-1]

    yield begin
    for served in opened:
        sys.stdout.write((tmp_path / "log").read_text())
        served.close()


def left_of(family, seconds):
    return [process.name() for process in psutil.wait_procs(family, seconds)[1]]


@pytest.mark.ray
def test_a_coordinator_that_loses_its_gcs_is_back_alone_and_leaves_nothing_when_killed(serve):
    served = serve("run_slowly")
    served.client.submit(spec_fields(2000))
    wait_for(lambda: served.done_by(set()))
    assert stat.S_IMODE((served.data / "ray.token").stat().st_mode) == 0o600
    first, family = served.workers(), served.family()
    gcs = next(process for process in family if process.name() == "gcs_server")
    os.kill(gcs.pid, signal.SIGKILL)
    lost, slowest = time.monotonic(), 0.0
    while not served.done_by(first):
        asked = time.monotonic()
        assert served.client.campaign(1).state == "active"
        slowest = max(slowest, time.monotonic() - asked)
        assert asked - lost < BACK_S
        time.sleep(0.1)
    sys.stdout.write(f"back after {time.monotonic() - lost:.1f} s, slowest answer {slowest:.2f} s\n")
    assert slowest < 5.0  # far above what it takes, far below a pause that somebody would notice
    # Of the first cluster nothing is left but the coordinator, which is not among its children.
    assert left_of(family, 10.0) == []
    family = served.family()
    assert len(family) > 6
    served.process.kill()
    assert left_of(family, 30.0) == []


@pytest.mark.ray
def test_a_stop_while_the_cluster_starts_is_obeyed_and_leaves_nothing(serve):
    served = serve("run_slowly")
    family = wait_for(lambda: (found := served.family()) and len(found) > 2 and found)
    begin = time.monotonic()
    served.process.send_signal(signal.SIGTERM)
    assert served.process.wait(timeout=60) == 0
    assert time.monotonic() - begin < STOPPED_S and left_of(family, 10.0) == []


def test_without_ray_its_executor_says_what_to_install(tmp_path):
    (tmp_path / "ray.py").write_text("raise ImportError(\"No module named 'ray'\")")
    command = [sys.executable, "-m", "tests.service.fake_coastarc", "run_fake", "serve", "--port", "0"]
    command += ["--data", str(tmp_path / "data"), "--executor", "ray"]
    environment = dict(os.environ) | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    said = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=ROOT, timeout=120)
    assert said.returncode == 2 and "Traceback" not in said.stderr
    assert "ray: expected the package, got No module named 'ray'; install it: pip install" in said.stderr
