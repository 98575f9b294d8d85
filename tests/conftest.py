"""What tests share: kernels compiled once, and a simulated Ray cluster, whose start takes many seconds."""

import fcntl
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import hypothesis
import pytest

from workers.process_tree import single_threaded

# Before NumPy is imported: threads of its library wait for each other in a loop, and on a busy machine half a
# second of arithmetic took half a minute of processor time.
os.environ.update(single_threaded(os.environ))

from tests.ray_clusters import nodes

COMPILE = (
    "from core import load_problem\n"
    "from workers.messages import JobSettings\n"
    "from workers.run import precompiled\n"
    "precompiled(load_problem('ppe-drm3').model_dump(mode='json'), JobSettings())"
)
# A busy machine takes its time, and no example is judged by it.
hypothesis.settings.register_profile("tests", deadline=None)
hypothesis.settings.load_profile("tests")
#: Names a file that is locked while kernels are compiled.
LOCK = "COASTARC_TESTS_COMPILING"
COMPILER = pytest.StashKey[subprocess.Popen]()


def pytest_sessionstart(session):
    """Compile once if tests run side by side, or each of their processes would, for a minute, the same."""
    if not session.config.getoption("numprocesses", None):
        return
    with tempfile.NamedTemporaryFile(delete=False) as lock:
        os.environ[LOCK] = lock.name
        # The lock is that of the file as it is open here and in the child: it ends with the child.
        fcntl.flock(lock, fcntl.LOCK_EX)
        command = [sys.executable, "-c", COMPILE]
        compiler = subprocess.Popen(command, pass_fds=[lock.fileno()])
    session.config.stash[COMPILER] = compiler


def pytest_collection_finish(session):
    """Wait, in each of the processes that run tests, until what they share is compiled."""
    if hasattr(session.config, "workerinput"):
        with open(os.environ[LOCK]) as lock:
            fcntl.flock(lock, fcntl.LOCK_SH)


def pytest_sessionfinish(session):
    """End what compiles, in a session that was cut short."""
    if compiler := session.config.stash.get(COMPILER, None):
        compiler.terminate()
        compiler.wait()
        Path(os.environ[LOCK]).unlink()


class LentCluster:
    """The connection of the whole session, which the executor of one test must not close."""

    def __init__(self, cluster):
        self._cluster = cluster

    def __getattr__(self, name):
        return getattr(self._cluster, name)

    def close(self):
        """Leave the connection as it is."""


def pytest_collection_modifyitems(items):
    """Call tests that need Ray slow; run their files last, so that others have the time of its processes."""
    for item in items:
        if item.get_closest_marker("ray"):
            item.add_marker("slow")
    files = {item.path for item in items if item.get_closest_marker("ray")}
    items.sort(key=lambda item: item.path in files)


@pytest.fixture(scope="session")
def simulated_cluster():
    """Give address and token of four nodes."""
    with nodes() as cluster:
        yield cluster


@pytest.fixture(scope="session")
def ray_cluster(simulated_cluster):
    from workers.ray_executor import RayCluster

    address, token = simulated_cluster
    joined = RayCluster(address, token=token)
    yield LentCluster(joined)
    joined.close()
