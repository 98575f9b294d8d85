"""Runs jobs on a Ray cluster, its own on this machine or one that it joins.

Ray moves messages and starts processes; it decides nothing.  It never retries, holds no more jobs than it has
processors, and may lose them all: the coordinator's leases bring them back.  This is the only file that
imports ray, and only when a cluster is opened, since ray reads its environment as it is imported.
"""

import json
import logging
import os
import signal
import socket
import sys
import threading
import time
import zlib
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from pathlib import Path
from typing import Any

import psutil

from workers.executor import CANCEL_GRACE_S, ExecutorError, ExecutorLostError
from workers.messages import Claim, Ended, Ending, Finished, HandedIn, Job, Sealed, Ticket, unpacked
from workers.process_tree import adopt_orphans, kill, kill_descendants
from workers.ray_nodes import (
    ForeignWorkerError,
    RayFolder,
    Watchdog,
    checked,
    difference,
    ended_after,
    execute,
    own_token,
    probe,
    require_short,
    require_token,
    versions,
)

LOG = logging.getLogger(__name__)

#: What a cluster of ours is started with, and what is read when Ray is imported.
ENVIRONMENT = {
    "RAY_USAGE_STATS_ENABLED": "0",
    # Without its GCS a driver ends by itself, but only after 60 s.
    "RAY_gcs_rpc_server_reconnect_timeout_s": "20",
}
#: Jobs and outcomes travel inline; the store of large objects stays as small as Ray permits [bytes].
OBJECT_STORE_BYTES = 80_000_000
#: Where core, workers and service are: Ray puts the folder that a driver stands in before all others in every
#: worker process, and a folder called `core` there would be imported in place of ours.
PACKAGES = Path(__file__).resolve().parents[1]
#: Without these a cluster of ours is none.
VITAL = ("gcs_server", "raylet")
#: A worker process ends after so many jobs, so that no leak lasts.
JOBS_PER_PROCESS = 200
#: How long Ray may take to start or to join, itself giving up after 30 s where it can [s].
INIT_S = 60.0
#: How long a coordinator of a cluster may take to answer, a node to start a process, a reply to arrive [s].
CONNECT_S, PROBE_S, REPLY_S = 5.0, 120.0, 30.0
#: How often capacity is looked up, since nodes come and go [s].
CAPACITY_S = 10.0
#: How long the processes of a cluster may take to leave [s].
LEAVE_S = 10.0


class RayCluster:
    """The connection of this process to a cluster, of which it can have one at a time.

    Open it in a thread that stays: the kernel ends Ray's processes with the thread that started them.
    """

    def __init__(
        self,
        address: str = "local",
        n_workers: int | None = None,
        token: Path | None = None,
        folder: Path | None = None,
    ) -> None:
        self.is_own = address == "local"
        self.ray: Any = None
        #: Whether the cluster is gone, so that there is nothing to leave.
        self.is_lost = False
        self._scratch: RayFolder | None = None
        try:
            if self.is_own:
                self._start(n_workers, own_token(token), folder)
            else:
                self._join(address, n_workers, token and checked(token))
            self.check()
        except ExecutorError:
            self.close()
            raise

    def check(self) -> None:
        """Run a task on every node that runs jobs, and refuse nodes of other versions than ours."""
        strategy = self.ray.util.scheduling_strategies.NodeAffinitySchedulingStrategy
        task = self.ray.remote(num_cpus=0, max_retries=0)(probe)
        nodes = [node for node in self.ray.nodes() if node["Alive"] and node["Resources"].get("CPU")]
        if not nodes:
            raise ExecutorError("ray cluster: expected at least 1 node with a processor, got none")
        probes = {
            node["NodeManagerHostname"] + " " + node["NodeID"][:8]: task.options(
                scheduling_strategy=strategy(node["NodeID"], soft=False)
            ).remote()
            for node in nodes
        }
        for node, reference in probes.items():
            self._check_node(node, reference)

    def require_alive(self) -> None:
        """Raise ExecutorLostError once a cluster of ours has lost a process that it cannot do without.

        Ray itself says so after 20 s, and never where its raylet is gone.
        """
        node = self.ray._private.worker._global_node if self.is_own else None
        for name, process in node.dead_processes() if node is not None else ():
            if name in VITAL:
                raise ExecutorLostError(
                    f"ray cluster: expected its {name} to run, got exit code {process.returncode}; "
                    "start the dispatcher again"
                )

    def n_processors(self) -> int:
        """Return the number of processors of the cluster as it is now."""
        return int(self.ray.cluster_resources().get("CPU", 0))

    def close(self) -> None:
        """Leave the cluster; one that was started here ends, with all its processes."""
        if self.is_lost and self.is_own:
            # In peace it would take 17 s more, and workers that were about to start would stay.
            kill_descendants()
        elif self.ray is not None and not self.is_lost:
            processes = list(self._processes())
            self.ray.shutdown()
            kill(psutil.wait_procs(processes, LEAVE_S)[1])
        if self._scratch is not None:
            self._scratch.close()

    def _start(self, n_workers: int | None, token: Path, folder: Path | None) -> None:
        n_workers = n_workers if n_workers is not None else os.cpu_count() or 1
        if n_workers < 1:
            raise ExecutorError(f"workers: expected at least 1, got {n_workers}")
        if folder is None:
            self._scratch = RayFolder()
            folder = self._scratch.path
        folder = require_short(folder)
        adopt_orphans()
        # One process more than jobs stays warm for the watchdog, which would start one each time.
        os.environ["RAY_num_workers_soft_limit"] = str(n_workers + 1)
        self._open(
            token,
            address="local",
            num_cpus=n_workers,
            include_dashboard=False,
            object_store_memory=OBJECT_STORE_BYTES,
            _temp_dir=str(folder),
        )

    def _join(self, address: str, n_workers: int | None, token: Path | None) -> None:
        if n_workers is not None:
            raise ExecutorError(f"workers: expected none for a cluster that has its own, got {n_workers}")
        host, _, port = address.rpartition(":")
        if not host or "/" in address or not port.isdigit():
            raise ExecutorError(f"ray address: expected local or host:port, got {address}")
        try:
            # Ray would end this whole process when the cluster does not answer.
            socket.create_connection((host.strip("[]"), int(port)), CONNECT_S).close()
        except OSError as error:
            raise ExecutorError(
                f"ray cluster: expected an answer from {address}, got {error}; `ray start --head` starts one"
            ) from error
        self._open(token, address=address)

    def _open(self, token: Path | None, **options: Any) -> None:
        self.ray = ray = _import_ray(token)
        try:
            with _signals_kept(), chdir(PACKAGES), ended_after(INIT_S):
                ray.init(log_to_driver=False, logging_level="ERROR", **options)
        except Exception as error:  # bare where a busy machine starts Ray too slowly
            cause = f"{type(error).__name__} ({error})"
            said = f"ray cluster {options['address']}: expected a connection, got {cause}"
            if self.is_own:
                raise ExecutorLostError(f"{said}; try again") from error
            raise ExecutorError(f"{said}; token, Ray and Python must be the same as here") from error
        # Ray would print on our stdout what its processes died of, with pages of their logs.
        ray._private.worker.print_to_stdstream = _log_first_line

    def _check_node(self, node: str, reference: Any) -> None:
        remedy = "install the same release on every node, in the same Python"
        try:
            found = self.ray.get(reference, timeout=PROBE_S)
        except self.ray.exceptions.GetTimeoutError as error:
            raise ExecutorLostError(
                f"ray node {node}: expected its versions in {PROBE_S:.0f} s, got none; try again"
            ) from error
        except self.ray.exceptions.RayError as error:
            # A node of ours has our release: whatever it cannot even run a task for, a new one will.
            has_died = self.is_own and not isinstance(error, self.ray.exceptions.RayTaskError)
            kind = ExecutorLostError if has_died else ExecutorError
            raise kind(f"ray node {node}: expected its versions, got {error}; {remedy}") from error
        if tuple(found) != tuple(versions()):
            raise ExecutorError(f"ray node {node}: {difference(versions(), found)}; {remedy}")

    def _processes(self) -> Iterator[psutil.Process]:
        node = self.ray._private.worker._global_node
        if not self.is_own or node is None:
            return
        for group in node.all_processes.values():
            for info in group:
                try:
                    process = psutil.Process(info.process.pid)
                    yield from process.children(recursive=True)
                    yield process
                except psutil.NoSuchProcess:
                    continue


def _import_ray(token: Path | None) -> Any:
    """Return ray, imported where it can see that it has to authenticate."""
    if "ray" in sys.modules and os.environ.get("RAY_AUTH_MODE") != "token":
        raise ExecutorError("ray: expected to be imported by its executor alone, got an import without token")
    require_token(os.environ, token)
    os.environ.update(ENVIRONMENT)
    try:
        import ray
        import ray.util.scheduling_strategies
    except ImportError as error:
        remedy = "install it: pip install -c constraints.txt -e '.[ray]'"
        raise ExecutorError(f"ray: expected the package, got {error}; {remedy}") from error
    return ray


def _log_first_line(data: dict[str, Any], ignore_prefix: bool = False) -> None:
    for message in data["lines"]:
        LOG.warning("ray: %s", message.partition("\n")[0])


@contextmanager
def _signals_kept() -> Iterator[None]:
    """Keep the handler of SIGTERM, which Ray takes for itself; a dispatcher drains in it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


class _Attempt:
    """A task of Ray, and what was asked of it."""

    def __init__(self, reference: Any) -> None:
        self.reference = reference
        self.patience_ends: float | None = None
        self.is_killed = False


class RayExecutor:
    """An executor of one task per processor of a cluster; `runner` names the function they call."""

    def __init__(
        self,
        cluster: RayCluster,
        runner: str = "workers.run:run_job",
        grace_s: float = CANCEL_GRACE_S,
        watchdog: Watchdog | None = None,
    ) -> None:
        self._cluster = cluster
        self._ray = cluster.ray
        self._runner = runner
        self._grace_s = grace_s
        self._watchdog = watchdog or Watchdog(cluster.ray)
        self._task = self._ray.remote(num_cpus=1, max_retries=0, max_calls=JOBS_PER_PROCESS)(execute)
        self._running: dict[Ticket, _Attempt] = {}
        self._window = (cluster.n_processors(), time.monotonic())

    def capacity(self) -> int:
        """Return the number of processors, or of jobs held where nodes have left since."""
        n_processors, seen = self._window
        if time.monotonic() - seen > CAPACITY_S:
            self._window = n_processors, _ = (self._cluster.n_processors(), time.monotonic())
        # Not more: the time a job may take counts from here, and must not be spent waiting inside Ray.
        return max(n_processors, len(self._running))

    def submit(self, ticket: Ticket, job: Job) -> None:
        """Hand a job to Ray."""
        n = self.capacity()
        if len(self._running) >= n:
            raise ExecutorError(
                f"ray executor: expected at most {n} jobs at a time, got job {ticket.job_id} too"
            )
        claim = Claim(**ticket._asdict(), job=job).model_dump_json()
        self._running[ticket] = _Attempt(self._task.remote(self._runner, claim, tuple(versions())))

    def finished(self, timeout: float) -> list[Finished]:
        """Return what has ended, after waiting at most `timeout` seconds for a first one."""
        try:
            return self._wait(time.monotonic() + timeout)
        except ExecutorLostError:
            self._cluster.is_lost = True
            raise

    def _wait(self, end: float) -> list[Finished]:
        while True:
            self._cluster.require_alive()
            self._watchdog.look()
            self._kill_overdue()
            # Short waits, so that a long one does not keep the watchdog from looking.
            patience = min(max(0.0, end - time.monotonic()), 1.0)
            done = self._ended_tasks(patience)
            if done or time.monotonic() >= end:
                return [Finished(ticket, self._outcome(self._running.pop(ticket))) for ticket in done]

    def handed_in(self) -> list[HandedIn]:
        """Return nothing: a task of Ray answers once, at its end."""
        return []

    def cancel(self, ticket: Ticket, force: bool = False) -> None:
        """Ask the attempt to stop at its next iteration and kill it after a grace, or kill it now."""
        attempt = self._running.get(ticket)
        if attempt is None or attempt.is_killed:
            return
        if force:
            attempt.is_killed = True
            self._ray.cancel(attempt.reference, force=True)
        elif attempt.patience_ends is None:
            attempt.patience_ends = time.monotonic() + self._grace_s
            self._ray.cancel(attempt.reference)

    def close(self) -> None:
        """Kill what runs, and leave the cluster, or end it if it is ours."""
        for ticket in self._running:
            self.cancel(ticket, force=True)
        self._running = {}
        self._cluster.close()

    def _kill_overdue(self) -> None:
        now = time.monotonic()
        for ticket, attempt in self._running.items():
            if attempt.patience_ends is not None and now > attempt.patience_ends:
                self.cancel(ticket, force=True)

    def _ended_tasks(self, patience: float) -> list[Ticket]:
        if not self._running:
            time.sleep(patience)
            return []
        tickets = {attempt.reference: ticket for ticket, attempt in self._running.items()}
        done, rest = self._ray.wait(list(tickets), num_returns=1, timeout=patience)
        if done and rest:
            done += self._ray.wait(rest, num_returns=len(rest), timeout=0)[0]
        return [tickets[reference] for reference in done]

    def _outcome(self, attempt: _Attempt) -> Sealed[Ended]:
        try:
            reply = self._ray.get(attempt.reference, timeout=REPLY_S)
            return unpacked(Ended, json.loads(zlib.decompress(reply)))
        except ForeignWorkerError as error:
            # Ray's error is of the class of its cause, but says the traceback.
            cause = getattr(error, "cause", error)
            raise ExecutorError(f"{cause}; install the same release on every node") from error
        except self._ray.exceptions.TaskCancelledError:
            return Sealed(Ended(ending=Ending.CANCELLED))
        except self._ray.exceptions.LocalRayletDiedError as error:
            # Every task ends so from now on: jobs would crash at once, again and again, and be given up.
            raise ExecutorLostError(
                f"ray cluster: expected a raylet, got {error}; start the dispatcher again"
            ) from error
        except self._ray.exceptions.RayError as error:
            if attempt.is_killed:
                return Sealed(Ended(ending=Ending.CANCELLED))
            return Sealed(Ended(ending=Ending.CRASH, error=f"worker process: expected a reply, got {error}"))
