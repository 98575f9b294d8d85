"""The command `coastarc`: one line per error, exit code 2, never a traceback for a user's mistake.

A command is imported when it is typed: all of them take seconds, many of them much less.  What a list of an
archive imports has its own test, and `python -m benchmarks.startup` measures it.
"""

import gc
import re
import signal
import sys
from collections.abc import Container, Mapping
from copy import copy
from importlib import import_module
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.text import Text
from typer import TyperException

from core.cache import cache_note
from core.errors import UserError

errors = Console(stderr=True)

#: Messages of the parser, and our form of them.
_MESSAGES = (
    (
        r"Invalid value for '([^']+)': Value error, (.+) is not one of (.+?)\.?",
        r"\1: expected one of \3, got \2",
    ),
    (r"Invalid value for '([^']+)': Input should be (.+?)(?:, unable to .*)?", r"\1: expected \2"),
    (r"Invalid value for '([^']+)': (.+)", r"\1: \2"),
    (r"Missing (?:option|argument) '([^']+)'.*", r"\1: expected a value, got none"),
    (
        r"No such (command|option):? ('?.+?'?)\.? Did you mean (.*)\?",
        r"\1: expected one that exists, got \2; did you mean \3",
    ),
    (r"No such command ('.*?')\.?(.*)", r"command: expected one that exists, got \1\2"),
    (r"No such option: (\S+)(.*)", r"option: expected one that exists, got \1\2"),
    (r"Got unexpected extra argument(?:s|\(s\))? \((.*)\)", r"arguments: expected no more, got \1"),
)


def print_error(message: str) -> None:
    """Print an error in one line."""
    # As text: users' input may look like markup.
    errors.print(Text.assemble(("error: ", "red"), message), soft_wrap=True)


def print_warning(message: str) -> None:
    """Print a warning in one line."""
    errors.print(Text.assemble(("warning: ", "yellow"), message), soft_wrap=True)


def fault_line(error: TyperException) -> str:
    """Return the error of a command in one line; empty where the help was printed instead."""
    if type(error).__name__ == "NoArgsIsHelpError":
        return ""
    text = " ".join(error.format_message().split())
    for pattern, form in _MESSAGES:
        match = re.fullmatch(pattern, text)
        if match:
            text = match.expand(form).strip()
            break
    context = getattr(error, "ctx", None)
    return f"{text}; see `{context.command_path} --help`" if context else text


#: Commands and groups in the order in which a newcomer needs them: place and summary of each.
COMMANDS = {
    "run": (
        "service.cli.run:run",
        "Run a campaign on this machine to its end; repeat the command to resume after an interruption.",
    ),
    "serve": (
        "service.cli.run:serve",
        "Serve the page and the API, and work on every campaign that is submitted, until interrupted.",
    ),
    "submit": ("service.cli.run:submit", "Submit a campaign to a running coordinator."),
    "dispatch": (
        "service.cli.processes:dispatch_command",
        "Work for a coordinator, here or elsewhere, until interrupted; several may work for one.",
    ),
    "status": (
        "service.cli.status:status",
        "Show campaigns, workers and dead jobs, or one campaign with its searches.",
    ),
    "watch": (
        "service.cli.control:watch",
        "Follow a campaign until it ends; with --json as one event a line.",
    ),
    "pause": (
        "service.cli.control:pause",
        "Stop handing out jobs of a campaign or of one search; running jobs finish.",
    ),
    "resume": ("service.cli.control:resume", "Resume a paused campaign, or one search of it."),
    "cancel": (
        "service.cli.control:cancel",
        "End a campaign, or one search of it, for good; running solves are stopped, results are kept.",
    ),
    "share": (
        "service.cli.control:share",
        "Set the priority and weight by which a campaign or one search shares the workers.",
    ),
    "solutions": (
        "service.cli.solutions:solutions",
        "List, show, verify, reproduce, refine and export solutions.",
    ),
    "seeds": (
        "service.cli.campaigns:seeds",
        "Show which solutions would seed a search or a problem, and by which mapping.",
    ),
    "report": (
        "service.cli.report:report",
        "Write the report of a campaign, finished or not: one HTML page, and its figures and tables.",
    ),
    "campaigns": ("service.cli.campaigns:campaigns", "Copy campaigns between installations."),
    "analyse": ("service.cli.analyse:analyse", "Analyse how a solution responds to outages."),
    "benchmark": (
        "service.cli.problem_set:benchmark",
        "Show and check the open set of robust problems; compare solutions with it.",
    ),
    "example": ("service.cli.report:example", "Run an example from end to end."),
    "bench": ("service.cli.bench:bench", "Measure the numerics on this machine."),
    "db": ("service.cli.db:db", "Upgrade, check, repair, back up and restore an archive."),
    "token": ("service.cli.token:token", "Make, list and revoke tokens."),
    "doctor": (
        "service.cli.processes:doctor",
        "Check this installation, and say what to do where something is missing.",
    ),
}

#: Commands that list what exists, for errors about what does not.
LISTS = {
    "campaign": "coastarc status",
    "solution": "coastarc solutions list",
    "token": "coastarc token list",
}

#: Those that compile kernels or make orbits.
_COMPUTING = {"run", "serve", "dispatch", "solutions", "analyse", "benchmark", "example", "bench"}


def app_of(typed: Container[str] | None = None) -> typer.Typer:
    """Return the command line; where words were typed, other commands are there for the help alone."""
    app = typer.Typer(
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
    )
    app.callback()(_options)
    _add_commands(app, COMMANDS, typed)
    return app


def _add_commands(
    app: typer.Typer, commands: Mapping[str, tuple[str, str]], typed: Container[str] | None
) -> None:
    for name, (place, summary) in commands.items():
        if typed is not None and name not in typed:
            app.command(name, help=summary)(_placeholder)
            continue
        module, _, attribute = place.partition(":")
        command = getattr(import_module(module), attribute)
        if isinstance(command, typer.Typer):
            group = copy(command)
            group.registered_commands = list(command.registered_commands)
            _add_commands(group, getattr(import_module(module), "LATER", {}), typed)
            app.add_typer(group, name=name)
        else:
            app.command(name)(command)


def _print_version(is_asked: bool) -> None:
    if is_asked:
        # Imported here: the help needs no message of a worker.
        from workers.provenance import code_version

        typer.echo(f"coastarc {code_version()}")
        raise typer.Exit


Version = Annotated[
    bool,
    typer.Option(
        "--version",
        metavar="",
        help="Print the release and the digest of its numerics.",
        is_eager=True,
        callback=_print_version,
    ),
]


def _options(version: Version = False) -> None:
    """Search for low-thrust trajectories that survive missed-thrust events."""


def _placeholder() -> None:
    """Stand for a command in the help."""


def main() -> None:
    """Run the command line."""
    for number in (signal.SIGINT, signal.SIGTERM):
        # A shell lets background jobs ignore SIGINT; whoever sends one means it.
        signal.signal(number, _as_interrupt)
    try:
        if set(sys.argv[1:2]) & _COMPUTING and (note := cache_note()):
            print_warning(note)
        # Not in standalone mode: errors of usage are printed in one line too.
        sys.exit(_imported(sys.argv[1:3])(prog_name="coastarc", standalone_mode=False) or 0)
    except typer.TyperException as error:
        if line := fault_line(error):
            print_error(line)
        sys.exit(2)
    except UserError as error:
        listed = LISTS.get(getattr(error, "noun", ""))
        print_error(f"{error}; see `{listed}`" if listed else str(error))
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)


def _imported(typed: Container[str]) -> typer.Typer:
    """Return the command line; to look for garbage in what is imported takes a tenth of a list's time."""
    gc.disable()
    app = app_of(typed)
    # Modules stay to the end: later collections pass them over too.
    gc.freeze()
    gc.enable()
    return app


def _as_interrupt(*_: Any) -> None:
    # A service manager's stop is a Ctrl-C: the same clean end.
    raise KeyboardInterrupt
