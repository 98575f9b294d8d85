"""A coordinator: archive, web server, background threads, and the dispatcher that it keeps as a child.

After a start it plans what is left of large campaigns, and reads the history of solves ahead, so that no page
has to wait for it.
"""

import hashlib
import logging
import platform
import re
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import uvicorn
from pydantic import SecretStr

from core.errors import UserError
from service.app import create_app
from service.auth.network import Access, access_on
from service.coordinator.connections import PatientProtocol, most_connections
from service.coordinator.lock import FolderLock, openness
from service.coordinator.reaper import Reaper
from service.coordinator.supervisor import LEAVE_S, Supervisor
from service.db.errors import UnavailableError, WriteError, unusable
from service.scheduler import LeaseSettings
from service.schemas.identity import Role
from service.settings import Settings
from service.store.store import Store
from workers.dispatch import RUNNER, DispatchOrder, ExecutorKind
from workers.retry import Downtime

log = logging.getLogger(__name__)

#: How long it waits while the archive cannot be used [s].
OUTAGE_PAUSE_S = 5.0


def finish_planning(store: Store, stop: threading.Event) -> None:
    """Plan the rest of every campaign, or until told to stop."""
    while not stop.is_set():
        try:
            for campaign_id in store.unplanned():
                log.warning("campaign %d: planning goes on that an end of the process cut off", campaign_id)
                store.plan_rest(campaign_id, stop.is_set)
            return
        except UnavailableError as error:
            store.downtime.tell(error)
            stop.wait(OUTAGE_PAUSE_S)
        except Exception:
            # The same submission again has its planning done as well, and is told what is wrong.
            log.exception("planning the rest of campaigns failed")
            return


#: Between two pieces the requests of pages and workers have their turn [s].
PAUSE_S = 0.02


def read_history(store: Store, stop: threading.Event) -> None:
    """Read to the end of the archive, or until told to stop; afterwards pages read what is new."""
    try:
        while _read(store, stop):
            pass
    except Exception:
        # A page that asks reads on from there, and is told what is wrong.
        log.exception("reading the archive ahead failed")


def _read(store: Store, stop: threading.Event) -> bool:
    """Read a piece and wait; return whether there may be more to read."""
    try:
        return store.read_history() and not stop.wait(PAUSE_S)
    except UnavailableError as error:
        store.downtime.tell(error)
        return not stop.wait(OUTAGE_PAUSE_S)


#: How long the web server may take to start or to stop [s].
SERVER_PATIENCE_S = 10.0
#: How long a dispatcher may take to leave a Ray cluster, which ends slowly [s].
LEAVE_CLUSTER_S = 20.0
#: How long a thread computes before another one may.  A claim waits for its turn after each
#: step of a query, beside each reader for as long as this; Python's own is 5 ms [s].
SWITCH_S = 5e-4
#: How often a database server is asked that does not answer at the start [s].
DATABASE_PERIOD_S = 2.0
#: How the names of the tokens of own dispatchers begin; each is made anew at every start, and nobody else
#: has it [days].
TOKEN_NAME, TOKEN_DAYS = "own dispatcher", 3650.0


class CoordinatorError(UserError, RuntimeError):
    """A part of the coordinator that failed."""


@dataclass(frozen=True, slots=True)
class WorkerSetup:
    """What the dispatcher of a coordinator works with."""

    n_workers: int | None = None
    executor: ExecutorKind = ExecutorKind.PROCESS
    #: What calls the solver, as module:name.
    runner: str = RUNNER


def local_name(folder: Path, folder_id: str) -> str:
    """Return what tells the coordinator of a data folder from all others on its database.

    A copied folder has the same id, and two machines may have the same host name.
    """
    digest = hashlib.blake2b(f"{folder.resolve()} {folder_id}".encode(), digest_size=8).hexdigest()
    # As long and of such letters as a token may be named.
    return re.sub(r"[^A-Za-z0-9._-]", "-", f"{digest}-{platform.node()[:30]}")


def local_prefix(name: str) -> str:
    """Return how the names of workers begin that end with the coordinator of a name.

    The next coordinator of the folder need not wait for their leases.
    """
    return f"local:{name}:"


@contextmanager
def _deaf_to_signals() -> Iterator[None]:
    """Ignore further SIGINT and SIGTERM during the shutdown, which is bounded in time."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, signal.SIG_IGN) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def open_port(host: str, port: int) -> socket.socket:
    """Return a bound socket; port 0 takes any that is free."""
    listener = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except socket.gaierror as error:
        listener.close()
        raise CoordinatorError(
            f"host {host}: expected an address of this machine, got {error.strerror}; use --host"
        ) from error
    except OSError as error:
        listener.close()
        raise CoordinatorError(
            f"port {port}: expected a free one, got {error.strerror}; use --port"
        ) from error
    return listener


class WebServer:
    """uvicorn on a thread, so that the main thread keeps the terminal and its signals."""

    def __init__(self, store: Store, listener: socket.socket, host: str, access: Access) -> None:
        #: How this machine reaches it: an address that stands for all of them is nobody's.
        reached = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
        shown = f"[{reached}]" if ":" in reached else reached
        self.url = f"http://{shown}:{listener.getsockname()[1]}"
        self._closing = threading.Event()
        self.app = create_app(store, self._closing.is_set, access)
        # Which proxy is believed is decided by `service.auth.network`, which has to see who really sends.
        config = uvicorn.Config(
            self.app,
            log_level="warning",
            access_log=False,
            proxy_headers=False,
            timeout_graceful_shutdown=1,
            http=PatientProtocol,
            limit_concurrency=most_connections(),
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._server.run, args=([listener],), name="web", daemon=True)

    def start(self) -> None:
        """Return when requests are answered."""
        sys.setswitchinterval(SWITCH_S)
        self._thread.start()
        deadline = time.monotonic() + SERVER_PATIENCE_S
        while not self._server.started:
            if not self._thread.is_alive() or time.monotonic() > deadline:
                raise CoordinatorError(f"web server: expected to start at {self.url}, got no answer")
            time.sleep(0.01)

    @property
    def is_alive(self) -> bool:
        """Whether requests are answered."""
        return self._thread.is_alive()

    def end_streams(self) -> None:
        """End the streams; everything else is answered still."""
        self._closing.set()

    def stop(self) -> None:
        """End the server."""
        self.end_streams()
        self._server.should_exit = True
        self._thread.join(SERVER_PATIENCE_S)


class Coordinator:
    """Owns a data folder while it is open; jobs that a dead predecessor left go back to the queue."""

    def __init__(
        self,
        folder: Path,
        host: str = "127.0.0.1",
        port: int = 0,
        leases: LeaseSettings = LeaseSettings(),  # noqa: B008
    ) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        except OSError as error:
            raise unusable(folder, error.strerror) from error
        self._lock = FolderLock(folder)
        self._folder = folder
        self._address = (host, port)
        self._stop = threading.Event()
        self._threads: list[threading.Thread] = []
        self._leases = leases
        self._supervisor: Supervisor | None = None

    def __enter__(self) -> Self:
        """Open archive and web server; no work begins yet."""
        with ExitStack() as opened:
            listener = opened.enter_context(open_port(*self._address))
            opened.enter_context(self._lock)
            if open_to_others := openness(self._folder):
                log.warning("%s", open_to_others)
            self.store = opened.enter_context(self._open_archive())
            self._name = local_name(self._folder, self._lock.folder_id)
            self.n_recovered = self.store.recover(local_prefix(self._name))
            host = self._address[0]
            access = access_on(host, Settings.from_environment(), self.store.identities.has_token)
            self._server = WebServer(self.store, listener, host, access)
            self._server.start()
            self._threads = [
                threading.Thread(target=Reaper(self.store, self._stop).run, name="reaper"),
                threading.Thread(target=read_history, args=(self.store, self._stop), name="history"),
                threading.Thread(target=finish_planning, args=(self.store, self._stop), name="planning"),
            ]
            for thread in self._threads:
                thread.start()
            # All of it stays open until `__exit__`.
            opened.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop in the order of the data: streams, then solves and their reports, then the archive."""
        with _deaf_to_signals():
            self._server.end_streams()
            self._stop.set()
            if self._supervisor is not None:
                self._supervisor.stop()
            for thread in self._threads:
                thread.join()
            self._server.stop()
            self.store.close()
            self._lock.__exit__()

    def _open_archive(self) -> Store:
        """Return the archive; a database server that does not answer yet is waited for."""
        downtime = Downtime("archive")
        while True:
            try:
                return Store(self._folder, leases=self._leases)
            except WriteError:
                # A full disk is reported to the user at once.
                raise
            except UnavailableError as error:
                downtime.tell(CoordinatorError(f"{error}; it is asked again every {DATABASE_PERIOD_S:g} s"))
                time.sleep(DATABASE_PERIOD_S)

    @property
    def url(self) -> str:
        """Where the page is."""
        return self._server.url

    def work(self, setup: WorkerSetup, campaign_id: int | None = None) -> None:
        """Begin to run jobs of one campaign, or of all, by a dispatcher that ends with the coordinator."""

        def order() -> DispatchOrder:
            # A token for each child, which has it in memory alone; those of other coordinators stay.
            made = self.store.identities.replace(f"{TOKEN_NAME} {self._name}", Role.WORKER, TOKEN_DAYS)
            return DispatchOrder(
                url=self.url,
                token=SecretStr(made.token),
                executor=setup.executor,
                n_workers=setup.n_workers,
                # Beside the archive, where a service may write; a home need not be.
                cluster_token=self._folder / "ray.token" if setup.executor is ExecutorKind.RAY else None,
                outbox=self._folder / "outbox",
                campaign_id=campaign_id,
                runner=setup.runner,
                prefix=local_prefix(self._name),
            )

        leave_s = LEAVE_CLUSTER_S if setup.executor is ExecutorKind.RAY else LEAVE_S
        supervisor = self._supervisor = Supervisor(order, leave_s)
        self._server.app.state.trouble = lambda: supervisor.trouble
        supervisor.start()

    def raise_fault(self) -> None:
        """Raise what keeps every dispatcher from working, if something does that does not pass by itself."""
        if not self._server.is_alive:
            raise CoordinatorError(f"web server: expected to run at {self.url}, got its end; see the log")
        if self._supervisor is not None and self._supervisor.fault is not None:
            raise CoordinatorError(self._supervisor.fault)
