"""The command `coastarc`: one line per error, exit code 2, never a traceback for what a user did."""

import json
import os
import signal
import sys
from pathlib import Path
from typing import Annotated, Any

import httpx
import typer
from platformdirs import user_data_path
from pydantic import BaseModel, TypeAdapter
from rich.console import Console
from rich.table import Table
from rich.text import Text

from service import terminal
from service.api.schemas import CampaignView, JobView
from service.cli_bench import bench
from service.cli_db import db
from service.cli_run import announce, run_to_end, serve_until_interrupted
from service.cli_token import TokenError, token
from service.coordinator import Coordinator, CoordinatorError
from service.db.engine import DatabaseError
from service.doctor import check_all
from service.lock import LockError
from service.resolve import require_flyable
from service.security import BindError
from service.settings import SettingsError
from service.spec import SpecError, load_spec
from service.store import Store, StoreError
from service.store.records import Filter
from workers.executor import ExecutorError

DEFAULT_PORT = 8741
#: What a user can cause, and mend.
USER_ERRORS = (
    SpecError,
    StoreError,
    DatabaseError,
    LockError,
    BindError,
    SettingsError,
    TokenError,
    CoordinatorError,
    ExecutorError,
)

app = typer.Typer(
    help="Search for low-thrust trajectories that survive missed-thrust events.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
solutions = typer.Typer(help="Look at solutions.", no_args_is_help=True)
app.add_typer(solutions, name="solutions")
app.add_typer(bench, name="bench")
app.add_typer(db, name="db")
app.add_typer(token, name="token")
# What is piped into a file has no width to respect.
console = Console(width=None if sys.stdout.isatty() else 140)
errors = Console(stderr=True)

SpecFile = Annotated[Path, typer.Argument(help="Campaign specification, .toml or .json.")]
Data = Annotated[Path, typer.Option(help="Folder of the archive.", envvar="COASTARC_DATA")]
DATA = user_data_path("coastarc")
Workers = Annotated[int, typer.Option(min=1, max=1024, help="Worker processes; one per core if left out.")]
WORKERS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
Host = Annotated[str, typer.Option(help="Loopback address to serve on.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
CampaignId = Annotated[int | None, typer.Option(help="Id of a campaign.")]


@app.command()
def run(
    spec: SpecFile,
    data: Data = DATA,
    workers: Workers = WORKERS,
    host: Host = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the page; 0 takes a free one.")] = 0,
) -> None:
    """Run a campaign on this machine to its end; the same command goes on after an interruption."""
    specification = load_spec(spec)
    require_flyable(specification)
    with Coordinator(data, host, port) as coordinator:
        campaign_id, is_new = coordinator.store.submit(specification)
        if n_revived := coordinator.store.revive(campaign_id):
            console.print(f"{n_revived} jobs that failed before are tried again.")
        if coordinator.store.campaign(campaign_id).state == "done":
            console.print(f"Campaign {campaign_id} has been run before; nothing is left to do.")
            is_finished = True
        else:
            announce(console, coordinator)
            if not is_new:
                console.print(f"Going on with campaign {campaign_id}, which was begun before.")
            is_finished = run_to_end(console, coordinator, campaign_id, workers)
        view = coordinator.store.campaign(campaign_id)
        dead = coordinator.store.jobs(campaign_id, None, "dead", limit=1).items
    _conclude(view, dead, is_finished)


def _conclude(view: CampaignView, dead: list[JobView], is_finished: bool) -> None:
    console.print(terminal.summary(view))
    if dead:
        n_dead = sum(search.jobs.dead for search in view.searches)
        _complain(f"{n_dead} jobs failed, the first with: {dead[0].error}")
        raise typer.Exit(1)
    if not is_finished:
        console.print("Interrupted; every result is kept, and the same command goes on.")
        raise typer.Exit(130)
    console.print("See all with `coastarc solutions list`, or in the browser with `coastarc serve`.")


@app.command()
def serve(
    data: Data = DATA,
    workers: Workers = WORKERS,
    host: Host = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port.")] = DEFAULT_PORT,
) -> None:
    """Serve the page and the API, and work on every campaign that is submitted, until interrupted."""
    with Coordinator(data, host, port) as coordinator:
        announce(console, coordinator)
        serve_until_interrupted(coordinator, workers)


@app.command()
def submit(
    spec: SpecFile,
    url: Annotated[
        str, typer.Option(help="Where `coastarc serve` runs.")
    ] = f"http://127.0.0.1:{DEFAULT_PORT}",
    as_json: Json = False,
) -> None:
    """Submit a campaign to a running coordinator."""
    body = load_spec(spec).as_fields()
    try:
        # The coordinator makes the departure and the target before it answers.
        answer = httpx.post(f"{url.rstrip('/')}/api/v1/campaigns", json=body, timeout=180)
    except (httpx.TransportError, httpx.InvalidURL) as error:
        advice = "start one with `coastarc serve`"
        raise CoordinatorError(f"coordinator: expected one at {url}, got {error}; {advice}") from error
    if answer.is_error:
        raise SpecError(_detail(answer))
    campaign = answer.json()
    if as_json:
        _print_json(campaign)
    else:
        news = "submitted" if answer.status_code == 201 else "is already there"
        console.print(f"Campaign {campaign['id']} ({campaign['name']}) {news}; watch it at {url}")


@app.command()
def status(data: Data = DATA, campaign: CampaignId = None, as_json: Json = False) -> None:
    """Show the campaigns of an archive, or one with its searches."""
    with Store(data, read_only=True) as store:
        if campaign is None:
            items = store.campaigns()
            _show(items, terminal.campaign_list(items), as_json)
        else:
            view = store.campaign(campaign)
            _show(view, terminal.summary(view), as_json)


@solutions.command("list")
def list_solutions(
    data: Data = DATA,
    campaign: CampaignId = None,
    search: Annotated[str | None, typer.Option(help="Name of a search.")] = None,
    strict: Annotated[
        bool | None, typer.Option("--strict/--paper-only", help="Only those that are, or are not, strict.")
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="At most so many, the best first.")] = None,
    as_json: Json = False,
) -> None:
    """List verified solutions, the least propellant first."""
    with Store(data, read_only=True) as store:
        records = store.all_records(Filter(campaign, search, strict), limit)
    _show(records, terminal.solution_list(records), as_json)


@solutions.command("show")
def show_solution(
    solution: Annotated[str, typer.Argument(help="Id of a solution, or its beginning.")],
    data: Data = DATA,
    as_json: Json = False,
) -> None:
    """Show one solution; its decision vector is in the JSON."""
    with Store(data, read_only=True) as store:
        record = store.record(store.find_solution(solution))
    if as_json:
        _print_json(record)
    else:
        terminal.print_record(console, record)


@app.command()
def doctor(
    data: Data = DATA,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to look at.")] = DEFAULT_PORT,
    as_json: Json = False,
) -> None:
    """Check this installation, and say what to do where something is missing."""
    checks = check_all(data, port)
    rows = terminal.table("check", "state", "found", "what to do")
    for check in checks:
        rows.add_row(check.name, check.state, check.found, check.advice)
    _show(checks, rows, as_json)
    if any(check.state == "failed" for check in checks):
        raise typer.Exit(1)


def main() -> None:
    """Run the command line."""
    for number in (signal.SIGINT, signal.SIGTERM):
        # A shell starts background jobs deaf to SIGINT; whoever sends one means it.
        signal.signal(number, _as_interrupt)
    try:
        app()
    except USER_ERRORS as error:
        _complain(str(error))
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)


def _complain(message: str) -> None:
    # As text: what users typed may look like markup.
    errors.print(Text.assemble(("error: ", "red"), message), soft_wrap=True)


def _as_interrupt(*_: Any) -> None:
    # A service manager's stop is a Ctrl-C: the same clean end.
    raise KeyboardInterrupt


def _show(content: Any, table: Table, as_json: bool) -> None:
    if as_json:
        _print_json(content)
    else:
        console.print(table)


def _print_json(content: Any) -> None:
    plain = content.model_dump(mode="json") if isinstance(content, BaseModel) else content
    typer.echo(json.dumps(TypeAdapter(Any).dump_python(plain, mode="json"), indent=2))


def _detail(answer: httpx.Response) -> str:
    try:
        return str(answer.json()["detail"])
    except (ValueError, KeyError, TypeError):
        return f"coordinator: expected a campaign, got status {answer.status_code} from {answer.url}"
