"""`coastarc run` and `coastarc serve`: work on campaigns on this machine, and show their progress.

`coastarc submit`: a campaign for a running coordinator.
"""

import errno
import shlex
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.live import Live

from core.orbits.reach import remarks_on
from service import logs
from service.cli import terminal
from service.cli.command import print_error, print_warning
from service.cli.options import (
    DATA,
    DEFAULT_PORT,
    DEFAULT_URL,
    WORKERS,
    Data,
    Json,
    SpecFile,
    Url,
    Workers,
    client_of,
    console,
    print_json,
)
from service.coordinator import Coordinator, WorkerSetup
from service.db.errors import UnavailableError
from service.db.transitions import ENDED
from service.schemas.campaign import CampaignView
from service.schemas.job import JobView
from service.spec import load_spec
from service.spec.spec_check import require_flyable
from service.store.store import Store
from workers.dispatch import RUNNER, ExecutorKind

Host = Annotated[str, typer.Option(help="Address to listen on; any other than loopback requires tokens.")]
Executor = Annotated[ExecutorKind, typer.Option(help="What runs the jobs.")]

#: Periods of redrawing the terminal, and of lines in a log [s].
TERMINAL_PERIOD_S = 1.0
LOG_PERIOD_S = 20.0
#: Period of checking whether a campaign has ended [s].
STATE_PERIOD_S = 0.5


def run(
    spec: SpecFile,
    data: Data = DATA,
    workers: Workers = WORKERS,
    executor: Executor = ExecutorKind.PROCESS,
    host: Host = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the page; 0 takes a free one.")] = 0,
) -> None:
    """Run a campaign on this machine to its end; repeat the command to resume after an interruption."""
    specification = load_spec(spec)
    require_flyable(specification.problem)
    for remark in remarks_on(specification.problem):
        print_warning(remark)
    # The terminal shows progress; log lines are for problems.
    logs.configure(level="WARNING")
    with Coordinator(data, host, port) as coordinator:
        campaign_id, is_new = coordinator.store.submit(specification)
        if n_requeued := coordinator.store.requeue_dead_jobs(campaign_id):
            console.print(f"{n_requeued} jobs that failed before are tried again.")
        is_finished = _resume(coordinator, campaign_id, is_new, worker_setup(executor, workers))
        view = coordinator.store.campaign(campaign_id)
        dead = coordinator.store.jobs(campaign_id, None, "dead", limit=1).items
    _conclude(view, dead, is_finished, data)


def _resume(coordinator: Coordinator, campaign_id: int, is_new: bool, setup: WorkerSetup) -> bool:
    """Run what is left of a campaign; return whether it has ended."""
    state = coordinator.store.campaign(campaign_id).state
    if state in ENDED:
        how = "run" if state == "done" else "cancelled"
        console.print(f"Campaign {campaign_id} has been {how} before; nothing is left to do.")
        return True
    announce(console, coordinator, f"/campaigns/{campaign_id}")
    if not is_new:
        console.print(f"Resuming campaign {campaign_id}.")
    if state == "paused":
        coordinator.store.control_campaign(campaign_id, "resume")
    return run_to_end(console, coordinator, campaign_id, setup)


def _conclude(view: CampaignView, dead: list[JobView], is_finished: bool, data: Path) -> None:
    console.print(terminal.summary(view))
    if dead:
        n_dead = sum(search.jobs.dead for search in view.searches)
        print_error(f"{n_dead} jobs failed, the first with: {dead[0].error}")
        raise typer.Exit(1)
    if not is_finished:
        console.print("Interrupted; every result is kept, and the same command resumes.")
        raise typer.Exit(130)
    where = "" if data == DATA else f" --data {shlex.quote(str(data))}"
    console.print(
        f"See all with `coastarc solutions list{where}`, or in the browser with `coastarc serve{where}`.",
        highlight=False,
        soft_wrap=True,
        markup=False,
    )


def serve(
    data: Data = DATA,
    workers: Annotated[
        int,
        typer.Option(
            min=0,
            max=1024,
            help="Worker processes, one per core if left out; 0 leaves the work to others.",
        ),
    ] = WORKERS,
    executor: Executor = ExecutorKind.PROCESS,
    host: Host = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the page and the API.")] = DEFAULT_PORT,
) -> None:
    """Serve the page and the API, and work on every campaign that is submitted, until interrupted."""
    logs.configure()
    with Coordinator(data, host, port) as coordinator:
        announce(console, coordinator)
        serve_until_interrupted(coordinator, worker_setup(executor, workers))


def worker_setup(executor: ExecutorKind, n_workers: int) -> WorkerSetup:
    """Return the settings of a dispatcher on this machine."""
    return WorkerSetup(n_workers, executor, RUNNER)


def reopen(store: Store, campaign_id: int) -> bool:
    """Retry the failed jobs of a campaign and resume it if it is paused; return whether it is to be run."""
    store.requeue_dead_jobs(campaign_id)
    if store.campaign_state(campaign_id) == "paused":
        store.control_campaign(campaign_id, "resume")
    return store.campaign_state(campaign_id) not in ENDED


def announce(console: Console, coordinator: Coordinator, page: str = "") -> None:
    """Print the address of the page, with a path below it, and the place of the archive."""
    console.print(f"Live page: {coordinator.url}{page}", highlight=False, soft_wrap=True)
    console.print(f"Archive:   {coordinator.store.folder}", highlight=False, soft_wrap=True, markup=False)


def run_to_end(console: Console, coordinator: Coordinator, campaign_id: int, setup: WorkerSetup) -> bool:
    """Work on a campaign and show its progress; return False after an interruption."""
    try:
        coordinator.work(setup, campaign_id)
        _follow(console, coordinator, campaign_id)
    except KeyboardInterrupt:
        console.print("Stopping; running solves hand in what they have ...")
        return False
    return True


def _follow(console: Console, coordinator: Coordinator, campaign_id: int) -> None:
    store, period = coordinator.store, TERMINAL_PERIOD_S if console.is_terminal else LOG_PERIOD_S
    view = store.campaign(campaign_id)
    next_look = time.monotonic() + period
    with Live(terminal.progress(view), console=console, transient=True, auto_refresh=False) as live:
        while not _has_ended(store, campaign_id):
            time.sleep(STATE_PERIOD_S)
            coordinator.raise_fault()
            if time.monotonic() < next_look:
                # Reading the whole view is expensive, and the processor is for the solves.
                continue
            # From now on: after a suspend there would else be a line for every period missed.
            next_look = time.monotonic() + period
            try:
                _show(console, live, store.campaign(campaign_id))
            except UnavailableError as error:
                store.downtime.tell(error)


def _show(console: Console, live: Live, view: CampaignView) -> None:
    try:
        if console.is_terminal:
            live.update(terminal.progress(view), refresh=True)
        else:
            console.print(terminal.progress_line(view), highlight=False)
    except OSError as error:
        # A log on a full disk is no reason to end a campaign.
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise


def _has_ended(store: Store, campaign_id: int) -> bool:
    try:
        return store.campaign_state(campaign_id) in ENDED
    except UnavailableError as error:
        # The database may come back; until then workers keep their results.
        store.downtime.tell(error)
        return False


def serve_until_interrupted(coordinator: Coordinator, setup: WorkerSetup) -> None:
    """Serve until Ctrl-C, and work on all campaigns unless that is left to dispatchers elsewhere."""
    try:
        if setup.n_workers != 0:
            coordinator.work(setup)
        while True:
            time.sleep(STATE_PERIOD_S)
            coordinator.raise_fault()
    except KeyboardInterrupt:
        return


def submit(
    spec: SpecFile,
    url: Url = DEFAULT_URL,
    key: Annotated[
        str | None,
        typer.Option(help="Idempotency key: repeated with the same text, a submission counts once."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Submit a campaign to a running coordinator."""
    with client_of(url) as client:
        campaign, is_new = client.submit(load_spec(spec).as_fields(), key)
    if as_json:
        print_json(campaign)
    else:
        news = "submitted" if is_new else "exists already"
        console.print(f"Campaign {campaign.id} ({campaign.name}) {news}; watch it at {url}")
        is_planned = all(one.seeds_from or one.state != "waiting" for one in campaign.searches)
        if is_new and not is_planned:
            console.print("It is large: its searches wait while the coordinator plans one after the other.")
