"""A dispatcher as a process: an executor on one side, a coordinator's API on the other, and nothing else.

`coastarc dispatch` runs it where an operator wants it.  A coordinator starts its own as a child by
`python -m workers.dispatch`: what to do comes as one line of JSON on stdin, with the token, which so stands
in no list of processes.  The line `stop` asks the child to end; if stdin closes, the coordinator is gone, and
the child ends too.  A token that is refused is replaced: the child prints `token wanted`, and gets a
line with another one.  Nothing heavy is imported here, so that it starts quickly.
"""

import json
import logging
import os
import platform
import re
import signal
import sys
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from io import FileIO
from pathlib import Path
from typing import Annotated

from platformdirs import user_data_path
from pydantic import Field, SecretStr

from workers import logs
from workers.child import runner_named
from workers.client import Api, ApiError, HttpSource
from workers.dispatcher import Dispatcher, Outbox
from workers.executor import Executor, ExecutorError, ExecutorLostError, Inline, ProcessPool
from workers.messages import Message, RefusedError, RowId, WorkerInfo
from workers.process_tree import Usage, kill_descendants
from workers.provenance import code_version

RUNNER = "workers.run:run_job"
#: Exit codes: an operator has to act; a new dispatcher is enough.
CANNOT_WORK, EXECUTOR_LOST = 2, 3
#: What a child and its coordinator say about tokens.
TOKEN_WANTED, NEW_TOKEN = "token wanted", "token "
#: How often a child asks for a token at most [s].
TOKEN_PERIOD_S = 5.0
#: What makes starting a dispatcher again useless.
FAULTS = (ApiError, RefusedError, ExecutorError)
#: How soon a start is broken off [s].
STOP_PERIOD_S = 0.2
#: How long an orphaned child may take to stop gracefully [s].
ORPHAN_S = 4.0


class ExecutorKind(StrEnum):
    """What runs the jobs."""

    INLINE = "inline"
    PROCESS = "process"
    RAY = "ray"


class DispatchOrder(Message):
    """What a dispatcher is to do."""

    url: str
    token: SecretStr | None = None
    executor: ExecutorKind = ExecutorKind.PROCESS
    #: None for one per processor, or for a cluster that has its own.
    n_workers: Annotated[int, Field(ge=1, le=1024)] | None = None
    #: Of a Ray cluster; `local` starts one.
    address: str = "local"
    cluster_token: Path | None = None
    #: Where outcomes wait that the coordinator does not take; None for a folder of the user's own.
    outbox: Path | None = None
    #: Only the jobs of one campaign.
    campaign_id: RowId | None = None
    #: What calls the solver, as module:name.
    runner: str = RUNNER
    #: How its name begins among the workers of the coordinator.
    prefix: str = ""

    def written(self) -> str:
        """Return the order as one line including its token, for a pipe."""
        token = self.token.get_secret_value() if self.token else None
        return json.dumps(self.model_dump(mode="json") | {"token": token})


class TokenLine:
    """Token renewal over the pipes to the coordinator."""

    def __init__(self) -> None:
        self._api: Api | None = None
        self._due = 0.0
        self._lock = threading.Lock()

    def serve(self, api: Api) -> None:
        """Set the client whose token is renewed."""
        self._api = api

    def ask(self) -> None:
        """Request a new token in place of a refused one; thread-safe, at most once per period."""
        with self._lock:
            if time.monotonic() < self._due:
                return
            self._due = time.monotonic() + TOKEN_PERIOD_S
            sys.stdout.write(f"{TOKEN_WANTED}\n")
            sys.stdout.flush()

    def take(self, token: str) -> None:
        """Use a new token."""
        if self._api is not None:
            self._api.use_token(token)


def dispatch(order: DispatchOrder, stop: threading.Event, tokens: TokenLine | None = None) -> None:
    """Work until told to stop; a refused token is fatal unless it can be renewed."""
    token = order.token.get_secret_value() if order.token else None
    with Api(order.url, token) as api:
        if tokens is not None:
            tokens.serve(api)
        executor = _executor(order, stop)
        try:
            worker = _worker(order, executor)
            logs.sign(worker=worker.name)
            source = HttpSource(api, tokens.ask if tokens else None)
            outbox = Outbox(order.outbox or _own_outbox(order.url))
            Dispatcher(source, executor, worker, order.campaign_id, Usage(), outbox).run(stop.is_set)
        finally:
            executor.close()


def _own_outbox(url: str) -> Path:
    """Return the outbox folder for one coordinator."""
    return user_data_path("coastarc") / "outbox" / re.sub("[^A-Za-z0-9.-]+", "-", url)[:100]


def stop_on_signals(stop: threading.Event) -> None:
    """Shut down gracefully on SIGINT and SIGTERM."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())


def _executor(order: DispatchOrder, stop: threading.Event) -> Executor:
    if order.executor is ExecutorKind.INLINE:
        return Inline(runner_named(order.runner), stop.is_set)
    if order.executor is ExecutorKind.PROCESS:
        return ProcessPool(order.n_workers or os.cpu_count() or 1, order.runner)
    # Read only where it is wanted: most installations have no Ray.
    from workers.ray_executor import RayCluster, RayExecutor

    with _broken_off_by(stop):
        cluster = RayCluster(order.address, order.n_workers, order.cluster_token)
    return RayExecutor(cluster, order.runner)


@contextmanager
def _broken_off_by(stop: threading.Event) -> Iterator[None]:
    """End this process and its descendants if a stop is requested meanwhile.

    Ray takes many seconds to start and listens to nobody; so early no job is held.
    """
    is_over = threading.Event()

    def watch() -> None:
        while not is_over.wait(STOP_PERIOD_S):
            if stop.is_set():
                _end_at_once(0)

    watcher = threading.Thread(target=watch, name="start", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        is_over.set()
        watcher.join()


def _end_at_once(code: int) -> None:
    kill_descendants()
    os._exit(code)


def _worker(order: DispatchOrder, executor: Executor) -> WorkerInfo:
    host = (platform.node() or "localhost").encode("ascii", "replace").decode()[:100]
    return WorkerInfo(
        # Two containers may have the same host name and the same process id.
        name=f"{order.prefix}{host}:{os.getpid()}:{uuid.uuid4().hex[:6]}",
        host=host,
        executor=order.executor.value,
        slots=executor.capacity(),
        code_version=code_version(),
        python_version=platform.python_version(),
    )


def _listen(orders: FileIO, stop: threading.Event, tokens: TokenLine) -> None:
    """Wait until the coordinator says stop or closes the pipe."""
    while (line := orders.readline().decode()).startswith(NEW_TOKEN):
        tokens.take(line.removeprefix(NEW_TOKEN).strip())
    if not line:
        # After that it is killed.
        timer = threading.Timer(ORPHAN_S, _end_at_once, (CANNOT_WORK,))
        timer.daemon = True
        timer.start()
    stop.set()


def main() -> int:
    """Run as the child of a coordinator; return the exit code, its reason being the last line printed."""
    logs.configure(level=logging.WARNING)
    stop = threading.Event()
    # Ctrl-C in the terminal is the coordinator's business, which then says so here.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    # Raw: the interpreter could not end while a thread waits in the buffer of `sys.stdin`.
    orders = FileIO(sys.stdin.fileno(), closefd=False)
    order = DispatchOrder.model_validate_json(orders.readline())
    tokens = TokenLine()
    threading.Thread(target=_listen, args=(orders, stop, tokens), name="orders", daemon=True).start()
    try:
        dispatch(order, stop, tokens)
    except FAULTS as error:
        sys.stdout.write(f"{error}\n")
        if isinstance(error, ExecutorLostError):
            sys.stdout.flush()
            # Ray would look for its cluster for 5 s more.
            _end_at_once(EXECUTOR_LOST)
        return CANNOT_WORK
    return 0


if __name__ == "__main__":
    sys.exit(main())
