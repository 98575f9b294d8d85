"""What counts as a cluster that is lost, told by a Ray that does nothing but answer as a test wants it."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.workers.jobs import hop_job
from workers.executor import ExecutorError, ExecutorLostError
from workers.messages import Ending, Ticket
from workers.ray_executor import RayCluster, RayExecutor
from workers.ray_nodes import Watchdog


class RayError(Exception):
    """As Ray's own, of which all its errors are."""


class LocalRayletDiedError(RayError):
    """What every task ends with once the cluster has noticed that the node of its driver is gone."""


class FakeRay:
    """Answers each task with the next of some outcomes; an error is raised, None is never there."""

    exceptions = SimpleNamespace(
        RayError=RayError,
        LocalRayletDiedError=LocalRayletDiedError,
        **{
            name: type(name, (RayError,), {})
            for name in ("GetTimeoutError", "RayTaskError", "TaskCancelledError")
        },
    )

    def __init__(self, outcomes):
        self._outcomes = iter(outcomes)

    def remote(self, **options):
        return lambda function: SimpleNamespace(remote=lambda *arguments: next(self._outcomes))

    def wait(self, references, num_returns=1, timeout=None):
        ready = [reference for reference in references if reference is not None]
        return ready, [reference for reference in references if reference is None]

    def get(self, reference, timeout=None):
        if isinstance(reference, Exception):
            raise reference
        return reference


def look_at(outcomes):
    """Look once for each question and each of its outcomes."""
    watchdog = Watchdog(FakeRay(outcomes), interval_s=0.0, timeout_s=0.0)
    for _ in range(2 * len(outcomes)):
        watchdog.look()


@pytest.mark.parametrize("outcomes", [[None, None], [RayError(), RayError()], [b"", None, RayError()]])
def test_two_questions_in_a_row_without_an_answer_or_with_an_error_are_a_lost_cluster(outcomes):
    # A cluster whose raylet was killed answers everything with errors, once it has noticed.
    with pytest.raises(ExecutorLostError, match="got none or an error, twice"):
        look_at(outcomes)


def test_one_question_that_fails_between_others_is_forgiven():
    # Its process may have been killed, as that of any job.
    look_at([b"", RayError(), b"", None, b"", RayError(), b""])


def executor_on(outcome):
    cluster = SimpleNamespace(ray=FakeRay([outcome]), n_processors=lambda: 1, require_alive=lambda: None)
    executor = RayExecutor(cluster, watchdog=SimpleNamespace(look=lambda: None))
    executor.submit(Ticket(1, 1), hop_job())
    return executor


def test_jobs_are_not_blamed_for_the_death_of_the_drivers_own_node():
    # Each would crash at once, three times in a few seconds, and be given up.
    with pytest.raises(ExecutorLostError, match="expected a raylet, got"):
        executor_on(LocalRayletDiedError("the task's local raylet died")).finished(0.0)


def test_a_process_that_died_is_the_crash_of_its_job_alone():
    (finished,) = executor_on(RayError("the worker died")).finished(0.0)
    assert finished.outcome.head.ending is Ending.CRASH


@pytest.mark.parametrize(
    ("is_own", "error", "kind"),
    [
        (True, LocalRayletDiedError(), ExecutorLostError),
        (True, FakeRay.exceptions.RayTaskError(), ExecutorError),
        (False, LocalRayletDiedError(), ExecutorError),
    ],
)
def test_a_node_of_ours_that_dies_before_its_check_is_started_again(is_own, error, kind):
    # A supervisor starts a lost executor again, and gives up over every other error.
    cluster = object.__new__(RayCluster)
    cluster.is_own, cluster.ray = is_own, FakeRay([])
    with pytest.raises(ExecutorError, match="expected its versions, got") as raised:
        cluster._check_node("node", error)
    assert type(raised.value) is kind


STUCK_IN_C = """
import ctypes, sys
from pathlib import Path
from types import SimpleNamespace
from workers import ray_executor
# Waits without letting go of the interpreter, as Ray does for a raylet that does not reply.
ray = SimpleNamespace(init=lambda **options: ctypes.PyDLL(None).sleep(600))
ray_executor._imported = lambda token: ray
ray_executor.INIT_S = 1.0
ray_executor.RayCluster(n_workers=1, token=Path(sys.argv[1]), folder=Path(sys.argv[2]))
"""


def test_a_start_that_is_stuck_in_ray_ends_its_process(tmp_path):
    # A worker that is killed while it starts keeps Ray from answering its driver, for ever.
    command = [sys.executable, "-c", STUCK_IN_C, tmp_path / "token", "/tmp/c"]
    ended = subprocess.run(
        command, cwd=Path(__file__).parents[2], capture_output=True, text=True, timeout=240, check=False
    )
    assert ended.returncode == 1 and "Timeout" in ended.stderr and "in _open" in ended.stderr
