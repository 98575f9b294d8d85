"""Everything that a round has started: a coordinator, perhaps a dispatcher elsewhere, and all below them.

Victims are found in the tree of processes that begins with these, never by a name alone: other clusters and
other services may run on the machine.  All of them carry a mark in their environment, by which those whose
parents were killed are found in the end.
"""

import ctypes
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import uuid
from dataclasses import dataclass
from pathlib import Path

import psutil

from tests.chaos.command import FAILURES, STALE_LINE
from tests.service.fake_coastarc import LEASE

ROOT = Path(__file__).parents[2]
RUNNER = "run_handing_in"
MARK = "COASTARC_CHAOS_MARK"
#: How long processes may take to stop in order, and those that lost their parents to end by themselves [s].
STOP_S, ORPHAN_S = 60.0, 15.0

COORDINATOR, DISPATCHER, POOL_WORKER = "coordinator", "dispatcher", "pool worker"
RAY_WORKER, RAY_AGENT, RAYLET, GCS = "ray worker", "ray agent", "raylet", "gcs_server"
#: Named as workers are, but a raylet ends with each of them.
AGENTS = ("ray::DashboardAgent", "ray::RuntimeEnvAgent")


@dataclass(frozen=True)
class SiteOrder:
    """What a round starts."""

    executor: str = "process"
    n_workers: int = 2
    #: One more dispatcher, of processes, which is no child of the coordinator.
    has_remote: bool = True
    #: None for the usual leases.
    lease_s: float | None = 6.0
    #: Failures after which a job is dead; None for the usual number.
    n_failures: int | None = None


@dataclass(frozen=True)
class Kill:
    """One victim, and when it died in seconds since 1970, as in the archive."""

    kind: str
    pid: int
    at: float
    #: Of the dispatcher above it, or of itself if it is one.
    dispatcher: int | None


class Site:
    """Starts, kills, starts again, and leaves nothing behind."""

    def __init__(self, folder: Path, order: SiteOrder) -> None:
        self.folder = folder
        self.archive = folder / "archive"
        self.order = order
        self.kills: list[Kill] = []
        self.faults: list[str] = []
        #: When the coordinator was last killed, by `time.monotonic`; infinite while that goes on.
        self.last_kill = float("-inf")
        self._mark = uuid.uuid4().hex
        self._started: list[subprocess.Popen] = []
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self._port = probe.getsockname()[1]
        self.url = f"http://127.0.0.1:{self._port}"
        folder.mkdir(parents=True)
        # Sockets of Ray have at most 107 bytes for their paths.
        self._scratch = tempfile.mkdtemp(prefix="c-", dir="/tmp")

    def __enter__(self):
        self._coordinator = self._serve()
        self._remote = self._dispatch() if self.order.has_remote else None
        return self

    def __exit__(self, *_):
        for process in self._started:
            if process.poll() is None:
                process.kill()
            process.wait()
        left = self.ours()
        for process in left:
            process.kill()
        psutil.wait_procs(left, 5.0)
        shutil.rmtree(self._scratch, ignore_errors=True)

    def keep_alive(self) -> None:
        """Start again what died without having been killed, which nothing here may do."""
        for name in ("_coordinator", "_remote"):
            process = getattr(self, name)
            if process is not None and process.poll() is not None:
                said = self.last_words(name.removeprefix("_"))
                self.faults.append(f"{name[1:]}: expected to live, got exit code {process.poll()}: {said}")
                self.last_kill = time.monotonic()
                setattr(self, name, self._serve() if name == "_coordinator" else self._dispatch())

    def victims(self, kind: str) -> list[psutil.Process]:
        """Return the processes of a kind that live now."""
        if kind == COORDINATOR:
            return [psutil.Process(self._coordinator.pid)]
        found = [process for process in self._below() if _kind_of(process) == kind]
        if kind == DISPATCHER and self._remote is not None:
            found.append(psutil.Process(self._remote.pid))
        return sorted(found, key=lambda process: process.pid)

    def kill(self, kind: str, victim: psutil.Process) -> Kill:
        """Kill one process, and start again what a service manager would start again."""
        dispatcher = self._dispatcher_of(victim)
        if kind == COORDINATOR:
            # Before the signal: what fails from now on fails for this.
            self.last_kill = float("inf")
        kill = Kill(kind, victim.pid, time.time(), dispatcher)
        victim.kill()
        for process in (self._coordinator, self._remote):
            if process is not None and process.pid == victim.pid:
                process.wait()
        if victim.pid == self._coordinator.pid:
            self.last_kill = time.monotonic()
            self._coordinator = self._serve()
        elif self._remote is not None and victim.pid == self._remote.pid:
            self._remote = self._dispatch()
        self.kills.append(kill)
        return kill

    @property
    def remote_pid(self) -> int:
        """The process id of the dispatcher elsewhere."""
        return self._remote.pid

    def freeze(self, seconds: float) -> None:
        """Stop the dispatcher elsewhere for longer than its leases, so that it comes back with stale ones."""
        os.kill(self._remote.pid, signal.SIGSTOP)
        time.sleep(seconds)
        os.kill(self._remote.pid, signal.SIGCONT)

    def stop(self) -> None:
        """End everything in order, as an operator would; note what does not."""
        for name, process in (("remote", self._remote), ("coordinator", self._coordinator)):
            if process is None:
                continue
            process.terminate()
            try:
                code = process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                code = f"none in {STOP_S:.0f} s"
            if code != 0:
                self.faults.append(f"{name}: expected exit code 0, got {code}: {self.last_words(name)}")
        left = [process.name() for process in psutil.wait_procs(self.ours(), ORPHAN_S)[1]]
        # Agents of a Ray driver that was killed live on for a minute; those of ours must not.
        if left and self.order.executor == "process":
            self.faults.append(f"processes: expected to have ended, got {left}")

    def ours(self) -> list[psutil.Process]:
        """Return all that lives of what was started here, whoever its parent is by now."""
        return [process for process in psutil.process_iter() if self._is_ours(process)]

    def n_stale(self) -> int:
        """Return how many reports were refused by the fence."""
        logs = self.folder.glob("coordinator*.log")
        return sum(log.read_text(errors="replace").count(STALE_LINE) for log in logs)

    def last_words(self, name: str) -> str:
        """Return the end of the newest log of a process."""
        logs = sorted(self.folder.glob(f"{name}-*.log"))
        return logs[-1].read_text(errors="replace")[-600:] if logs else ""

    def _serve(self) -> subprocess.Popen:
        executor = ("--workers", self.order.n_workers, "--executor", self.order.executor)
        return self._start("coordinator", "serve", "--data", self.archive, "--port", self._port, *executor)

    def _dispatch(self) -> subprocess.Popen:
        runner = ("--runner", f"tests.workers.fake:{RUNNER}", "--workers", 1)
        return self._start("remote", "dispatch", "--url", self.url, *runner)

    def _start(self, name: str, *arguments) -> subprocess.Popen:
        command = [sys.executable, "-m", "tests.chaos.command", RUNNER, *map(str, arguments)]
        with (self.folder / f"{name}-{len(self._started):04d}.log").open("w") as log:
            process = subprocess.Popen(
                command,
                stdout=log,
                stderr=log,
                cwd=ROOT,
                env=self._environment(),
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )
        self._started.append(process)
        return process

    def _environment(self) -> dict[str, str]:
        # Folders that Ray leaves behind when its driver is killed, and its token, go with the round.
        own = {MARK: self._mark, "TMPDIR": self._scratch, "XDG_DATA_HOME": str(self.folder)}
        if self.order.lease_s is not None:
            own[LEASE] = str(self.order.lease_s)
        if self.order.n_failures is not None:
            own[FAILURES] = str(self.order.n_failures)
        return dict(os.environ) | own

    def _below(self) -> list[psutil.Process]:
        found = []
        for process in (self._coordinator, self._remote):
            try:
                found += psutil.Process(process.pid).children(recursive=True) if process else []
            except psutil.NoSuchProcess:
                continue
        return found

    def _dispatcher_of(self, victim: psutil.Process) -> int | None:
        dispatchers = {process.pid for process in self.victims(DISPATCHER)}
        try:
            line = [victim, *victim.parents()]
        except psutil.NoSuchProcess:
            return None
        return next((process.pid for process in line if process.pid in dispatchers), None)

    def _is_ours(self, process: psutil.Process) -> bool:
        try:
            return process.pid != os.getpid() and process.environ().get(MARK) == self._mark
        except psutil.Error:
            return False


def _kind_of(process: psutil.Process) -> str | None:
    try:
        command = process.cmdline()
        if process.status() == psutil.STATUS_ZOMBIE or not command:
            return None
        if "workers.dispatch" in command:
            return DISPATCHER
        if "workers.child" in command:
            return POOL_WORKER
        if command[0].startswith("ray::"):
            return RAY_AGENT if command[0].startswith(AGENTS) else RAY_WORKER
        return process.name() if process.name() in (RAYLET, GCS) else None
    except psutil.NoSuchProcess:
        return None


def _die_with_parent() -> None:
    # Should the suite itself be killed, the kernel ends what it started.
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)
