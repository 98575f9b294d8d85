"""What commands share: options, the client of a coordinator, and printing of answers."""

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from platformdirs import user_data_path
from pydantic import BaseModel, TypeAdapter
from rich.console import Console
from rich.table import Table

from core.plain_data import read_text
from service.cli import terminal
from service.schemas.answer import Check
from service.settings import Settings, SettingsError

if TYPE_CHECKING:
    from service.client import Client

DEFAULT_PORT = 8741
DEFAULT_URL = f"http://127.0.0.1:{DEFAULT_PORT}"
DATA = user_data_path("coastarc")
WORKERS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

SpecFile = Annotated[Path, typer.Argument(help="Campaign specification, .toml or .json.")]
Data = Annotated[Path, typer.Option(help="Folder of the archive.", envvar="COASTARC_DATA")]
Workers = Annotated[int, typer.Option(min=1, max=1024, help="Worker processes; one per core if left out.")]
#: The empty metavar: typer would write <bool> behind a flag, which takes no value.
Json = Annotated[bool, typer.Option("--json", metavar="", help="Print JSON.")]
Url = Annotated[str, typer.Option(help="Where the coordinator is.", envvar="COASTARC_URL")]
MaybeUrl = Annotated[
    str | None,
    typer.Option(help="Ask this coordinator, instead of reading the archive.", envvar="COASTARC_URL"),
]

# Output that is piped into a file has no terminal width.
console = Console(width=None if sys.stdout.isatty() else 140)


def client_of(url: str) -> "Client":
    """Return a client with the token of the environment."""
    # Imported here: reading an archive needs no HTTP.
    from service.client import Client

    return Client(url, token_of(None))


def token_of(path: Path | None) -> str | None:
    """Return the token in a file, or the one of the environment."""
    if path is None:
        mine = Settings.from_environment().token
        return mine.get_secret_value() if mine else None
    try:
        token = read_text(path).strip()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SettingsError(f"--token-file: expected a file with a token, got {path}: {reason}") from None
    if not token:
        raise SettingsError(f"--token-file: expected a file with a token, got {path}, which is empty")
    return token


def print_json(content: Any) -> None:
    """Print an answer as JSON."""
    plain = content.model_dump(mode="json") if isinstance(content, BaseModel) else content
    typer.echo(json.dumps(TypeAdapter(Any).dump_python(plain, mode="json"), indent=2))


def show_checks(checks: Sequence[Check], as_json: bool) -> None:
    """Print checks as JSON or as a table; exit with code 1 if one failed."""
    rows = terminal.table("check", "state", "found", "what to do")
    for check in checks:
        rows.add_row(check.name, check.state, check.found, check.advice)
    show(checks, rows, as_json)
    if any(check.state == "failed" for check in checks):
        raise typer.Exit(1)


def show(content: Any, table: Table, as_json: bool) -> None:
    """Print an answer as JSON, or as the table that it makes."""
    if as_json:
        print_json(content)
    else:
        console.print(table)
