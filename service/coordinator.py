"""A coordinator with its own workers in one process tree: archive, dispatcher thread, web server thread."""

import os
import platform
import socket
import threading
import time
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Self

import uvicorn

from service.app import create_app
from service.db.engine import unusable
from service.lock import FolderLock
from service.security import require_loopback
from service.store import Store
from workers.dispatcher import Dispatcher
from workers.executor import Executor, Ticket
from workers.job import Claim, JobOutcome

#: How long the web server may take to start or to stop [s].
SERVER_PATIENCE_S = 10.0


class CoordinatorError(RuntimeError):
    """A part of the coordinator that failed."""


class LocalSource:
    """The store as a source of jobs, of one campaign or of all."""

    def __init__(self, store: Store, campaign_id: int | None) -> None:
        self._store = store
        self._campaign_id = campaign_id

    def claim(self, worker: str, n_jobs: int) -> Sequence[Claim]:
        """Hand out jobs."""
        return self._store.claim(worker, n_jobs, self._campaign_id)

    def heartbeat(self, worker: str, held: Iterable[Ticket]) -> Sequence[Ticket]:
        """Extend the leases; return what is to be cancelled, or somebody else's by now."""
        answer = self._store.heartbeat(worker, held)
        return [Ticket(job.job_id, job.attempt) for job in (*answer.to_cancel, *answer.not_held)]

    def complete(self, ticket: Ticket, outcome: JobOutcome) -> None:
        """Take back an outcome."""
        self._store.complete(ticket, outcome)


def open_port(host: str, port: int) -> socket.socket:
    """Return a bound socket on a loopback address; port 0 takes any that is free."""
    require_loopback(host)
    listener = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except OSError as error:
        listener.close()
        raise CoordinatorError(
            f"port {port}: expected a free one, got {error.strerror}; use --port"
        ) from error
    return listener


class WebServer:
    """uvicorn on a thread, so that the main thread keeps the terminal and its signals."""

    def __init__(self, store: Store, listener: socket.socket, host: str) -> None:
        shown = f"[{host}]" if ":" in host else host
        self.url = f"http://{shown}:{listener.getsockname()[1]}"
        self._closing = threading.Event()
        app = create_app(store, is_closing=self._closing.is_set)
        config = uvicorn.Config(app, log_level="warning", access_log=False, timeout_graceful_shutdown=2)
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._server.run, args=([listener],), name="web", daemon=True)

    def start(self) -> None:
        """Return when requests are answered."""
        self._thread.start()
        deadline = time.monotonic() + SERVER_PATIENCE_S
        while not self._server.started:
            if not self._thread.is_alive() or time.monotonic() > deadline:
                raise CoordinatorError(f"web server: expected to start at {self.url}, got no answer")
            time.sleep(0.01)

    def stop(self) -> None:
        """End the streams, then the server."""
        self._closing.set()
        self._server.should_exit = True
        self._thread.join(SERVER_PATIENCE_S)


class Coordinator:
    """Owns a data folder while it is open; jobs that a dead predecessor left go back to the queue."""

    def __init__(self, folder: Path, host: str = "127.0.0.1", port: int = 0) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unusable(folder, error.strerror) from error
        self._lock = FolderLock(folder)
        self._folder = folder
        self._address = (host, port)
        self._stop = threading.Event()
        self._worker: threading.Thread | None = None
        self._executor: Executor | None = None
        self._fault: BaseException | None = None

    def __enter__(self) -> Self:
        """Open archive and web server; no work begins yet."""
        with ExitStack() as opened:
            listener = opened.enter_context(open_port(*self._address))
            opened.enter_context(self._lock)
            self.store = opened.enter_context(Store(self._folder))
            self.n_recovered = self.store.recover()
            self._server = WebServer(self.store, listener, self._address[0])
            self._server.start()
            # All of it stays open until `__exit__`.
            opened.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop in the order of the data: solves, then pages, then the archive."""
        self._stop.set()
        if self._worker is not None:
            self._worker.join()
        if self._executor is not None:
            self._executor.close()
        self._server.stop()
        self.store.close()
        self._lock.__exit__()

    @property
    def url(self) -> str:
        """Where the page is."""
        return self._server.url

    def work(self, executor: Executor, campaign_id: int | None = None) -> None:
        """Begin to run jobs of one campaign, or of all; the executor is closed with the coordinator."""
        self._executor = executor
        source = LocalSource(self.store, campaign_id)
        dispatcher = Dispatcher(source, executor, worker=f"{platform.node()}:{os.getpid()}")
        self._worker = threading.Thread(target=self._dispatch, args=(dispatcher,), name="dispatcher")
        self._worker.start()

    def raise_fault(self) -> None:
        """Raise what ended the dispatcher, if something did."""
        if self._fault is not None:
            raise CoordinatorError(f"dispatcher: expected to run, got {self._fault!r}") from self._fault

    def _dispatch(self, dispatcher: Dispatcher) -> None:
        try:
            dispatcher.run(self._stop.is_set)
        except Exception as fault:
            self._fault = fault
