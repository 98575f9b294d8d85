"""The command `coastarc`: one line per error, exit code 2, never a traceback for what a user did."""

import signal
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from core.export import ExportError
from core.problem import ProblemError
from service import cli_control, logs, terminal
from service.api.schemas import CampaignView, JobView
from service.benchmark.benchmark_set import BenchmarkError
from service.cli_analyse import analyse
from service.cli_bench import bench
from service.cli_benchmark import benchmark
from service.cli_campaigns import campaigns
from service.cli_db import db
from service.cli_dispatch import DispatchError, dispatch_command
from service.cli_example import ExampleError, example
from service.cli_export import export_command
from service.cli_faults import InOrder, fault_line
from service.cli_options import (
    DATA,
    DEFAULT_PORT,
    DEFAULT_URL,
    WORKERS,
    Data,
    Json,
    Url,
    Workers,
    client_of,
    console,
    print_json,
)
from service.cli_refine import refine_command
from service.cli_report import ReportError, report
from service.cli_reproduce import reproduce_command
from service.cli_run import announce, crew_of, run_to_end, serve_until_interrupted
from service.cli_token import TokenError, token
from service.cli_verify import verify_command
from service.client import ClientError
from service.coordinator import Coordinator, CoordinatorError, Crew
from service.db.engine import DatabaseError
from service.doctor import check_all
from service.lock import LockError
from service.missed_thrust_spec import GridError
from service.new_file import FileError
from service.portable.errors import PortableError
from service.refine import RefineError
from service.resolve import require_flyable
from service.security import BindError
from service.settings import SettingsError
from service.spec import SpecError, load_spec
from service.store import Store, StoreError
from service.store.filter import filter_of
from service.store.page import Order, Sort
from service.terminal_verify import print_certificate
from service.verification import VerificationError
from workers.client import ApiError
from workers.dispatch import ExecutorKind
from workers.executor import ExecutorError
from workers.provenance import code_version
from workers.source import SourceError

#: What a user can cause, and mend.
USER_ERRORS = (
    SpecError,
    StoreError,
    DatabaseError,
    LockError,
    BindError,
    SettingsError,
    TokenError,
    ReportError,
    CoordinatorError,
    ExecutorError,
    DispatchError,
    ClientError,
    ApiError,
    SourceError,
    VerificationError,
    RefineError,
    ProblemError,
    ExportError,
    FileError,
    PortableError,
    GridError,
    ExampleError,
    BenchmarkError,
)

app = typer.Typer(
    cls=InOrder,
    help="Search for low-thrust trajectories that survive missed-thrust events.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
solutions = typer.Typer(help="Look at solutions, find them again, take them away.", no_args_is_help=True)
app.add_typer(solutions, name="solutions")
app.add_typer(campaigns, name="campaigns")
solutions.command("reproduce")(reproduce_command)
solutions.command("verify")(verify_command)
solutions.command("refine")(refine_command)
solutions.command("export")(export_command)
app.add_typer(analyse, name="analyse")
app.add_typer(bench, name="bench")
app.add_typer(benchmark, name="benchmark")
app.command()(report)
app.add_typer(db, name="db")
app.add_typer(example, name="example")
app.add_typer(token, name="token")
app.command("dispatch")(dispatch_command)
for command in (
    cli_control.status,
    cli_control.watch,
    cli_control.pause,
    cli_control.resume,
    cli_control.cancel,
    cli_control.share,
    cli_control.seeds,
):
    app.command()(command)
errors = Console(stderr=True)

SpecFile = Annotated[Path, typer.Argument(help="Campaign specification, .toml or .json.")]
Host = Annotated[str, typer.Option(help="Address to serve on; another than loopback asks for tokens.")]
Executor = Annotated[ExecutorKind, typer.Option(help="What runs the jobs.")]
CampaignName = Annotated[str | None, typer.Option(help="Id or name of a campaign.")]


def _print_version(is_asked: bool) -> None:
    if is_asked:
        typer.echo(f"coastarc {code_version()}")
        raise typer.Exit


@app.callback()
def _root(
    is_asked: Annotated[
        bool,
        typer.Option(
            "--version",
            metavar="",
            callback=_print_version,
            is_eager=True,
            help="Print the release and the digest of its numerics.",
        ),
    ] = False,
) -> None:
    """Search for low-thrust trajectories that survive missed-thrust events."""


@app.command()
def run(
    spec: SpecFile,
    data: Data = DATA,
    workers: Workers = WORKERS,
    executor: Executor = ExecutorKind.PROCESS,
    host: Host = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the page; 0 takes a free one.")] = 0,
) -> None:
    """Run a campaign on this machine to its end; the same command goes on after an interruption."""
    specification = load_spec(spec)
    require_flyable(specification.problem)
    # The terminal shows how far it is; a line beside that is for what goes wrong.
    logs.configure(level="WARNING")
    with Coordinator(data, host, port) as coordinator:
        campaign_id, is_new = coordinator.store.submit(specification)
        if n_revived := coordinator.store.revive(campaign_id):
            console.print(f"{n_revived} jobs that failed before are tried again.")
        is_finished = _go_on(coordinator, campaign_id, is_new, crew_of(executor, workers))
        view = coordinator.store.campaign(campaign_id)
        dead = coordinator.store.jobs(campaign_id, None, "dead", limit=1).items
    _conclude(view, dead, is_finished)


def _go_on(coordinator: Coordinator, campaign_id: int, is_new: bool, crew: Crew) -> bool:
    """Run what is left of a campaign; return whether it is at its end."""
    state = coordinator.store.campaign(campaign_id).state
    if state in ("done", "cancelled"):
        how = "run" if state == "done" else "cancelled"
        console.print(f"Campaign {campaign_id} has been {how} before; nothing is left to do.")
        return True
    announce(console, coordinator, f"/campaigns/{campaign_id}")
    if not is_new:
        console.print(f"Going on with campaign {campaign_id}, which was begun before.")
    if state == "paused":
        coordinator.store.control_campaign(campaign_id, "resume")
    return run_to_end(console, coordinator, campaign_id, crew)


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
        serve_until_interrupted(coordinator, crew_of(executor, workers))


@app.command()
def submit(
    spec: SpecFile,
    url: Url = DEFAULT_URL,
    key: Annotated[
        str | None, typer.Option(help="Any text; repeated with it, a submission counts once.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Submit a campaign to a running coordinator."""
    with client_of(url) as client:
        campaign, is_new = client.submit(load_spec(spec).as_fields(), key)
    if as_json:
        print_json(campaign)
    else:
        news = "submitted" if is_new else "is already there"
        console.print(f"Campaign {campaign.id} ({campaign.name}) {news}; watch it at {url}")


@solutions.command("list")
def list_solutions(
    data: Data = DATA,
    campaign: CampaignName = None,
    search: Annotated[str | None, typer.Option(help="Name of a search.")] = None,
    strategy: Annotated[str | None, typer.Option(help='Strategy, as "S(1|0)".')] = None,
    k: Annotated[int | None, typer.Option(min=0, help="Number of outages survived.")] = None,
    segment: Annotated[int | None, typer.Option(min=1, help="Segment that an outage misses.")] = None,
    duration: Annotated[float | None, typer.Option(help="Length of the same outage, in days.")] = None,
    strict: Annotated[
        bool | None,
        typer.Option("--strict/--paper-only", metavar="", help="Only those that are, or are not, strict."),
    ] = None,
    sort: Annotated[Sort, typer.Option(help="What they are sorted by.")] = "objective_kg",
    limit: Annotated[int | None, typer.Option(min=1, help="At most so many, the first by --sort.")] = None,
    as_json: Json = False,
) -> None:
    """List verified solutions, the least propellant first unless --sort says otherwise."""
    with Store(data, read_only=True) as store:
        wanted = filter_of(
            campaign=None if campaign is None else store.find_campaign(campaign),
            search=search,
            strategy=strategy,
            k=k,
            segment=segment,
            duration_days=duration,
            strict=strict,
        )
        records = store.all_records(wanted, limit, Order(sort))
    if records or as_json:
        _show(records, terminal.solution_list(records), as_json)
    else:
        console.print("No solution of this archive is so.")


@solutions.command("show")
def show_solution(
    solution: Annotated[str, typer.Argument(help="Id of a solution, or its beginning.")],
    data: Data = DATA,
    as_json: Json = False,
) -> None:
    """Show one solution and its certificate; its decision vector is in the JSON."""
    with Store(data, read_only=True) as store:
        record = store.record(store.find_solution(solution))
        certificate = store.certificates.latest(record.id)
    if as_json:
        shown = certificate and certificate.model_dump(mode="json")
        print_json(record.model_dump(mode="json") | {"certificate": shown})
    else:
        terminal.print_record(console, record)
        print_certificate(console, certificate)


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
        # Not by itself: what was typed wrongly is told in one line too.
        sys.exit(app(prog_name="coastarc", standalone_mode=False) or 0)
    except typer.TyperException as error:
        if line := fault_line(error):
            _complain(line)
        sys.exit(2)
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
        print_json(content)
    else:
        console.print(table)
