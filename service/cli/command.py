"""The command `coastarc`: one line per error, exit code 2, never a traceback for what a user did."""

import signal
import sys
from typing import Any

import typer

from core.export import ExportError
from core.problem import ProblemError
from service.access.security import BindError
from service.benchmark.benchmark_set import BenchmarkError
from service.cli import control
from service.cli.analyse import analyse
from service.cli.bench import bench
from service.cli.benchmark import benchmark
from service.cli.campaigns import campaigns
from service.cli.db import db
from service.cli.dispatch import DispatchError, dispatch_command
from service.cli.doctor import doctor
from service.cli.example import ExampleError, example
from service.cli.faults import InOrder, fault_line
from service.cli.options import complain
from service.cli.report import ReportError, report
from service.cli.run import run, serve
from service.cli.solutions import solutions
from service.cli.submit import submit
from service.cli.token import TokenError, token
from service.client import ClientError
from service.coordinator import CoordinatorError
from service.coordinator.lock import LockError
from service.db.engine import DatabaseError
from service.missed_thrust.analysis_spec import GridError
from service.new_file import FileError
from service.portable.errors import PortableError
from service.settings import SettingsError
from service.solutions.refine import RefineError
from service.solutions.verification import VerificationError
from service.spec import SpecError
from service.store import StoreError
from workers.client import ApiError
from workers.executor import ExecutorError
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
for name, group in (
    ("solutions", solutions),
    ("campaigns", campaigns),
    ("analyse", analyse),
    ("bench", bench),
    ("benchmark", benchmark),
    ("db", db),
    ("example", example),
    ("token", token),
):
    app.add_typer(group, name=name)
for command in (
    run,
    serve,
    submit,
    control.status,
    control.watch,
    control.pause,
    control.resume,
    control.cancel,
    control.share,
    control.seeds,
    report,
    doctor,
):
    app.command()(command)
app.command("dispatch")(dispatch_command)


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
            complain(line)
        sys.exit(2)
    except USER_ERRORS as error:
        complain(str(error))
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)


def _as_interrupt(*_: Any) -> None:
    # A service manager's stop is a Ctrl-C: the same clean end.
    raise KeyboardInterrupt
