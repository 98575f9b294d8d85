"""`coastarc doctor`: the checks of this installation as a table."""

from typing import Annotated

import typer

from service.cli import terminal
from service.cli.options import DATA, DEFAULT_PORT, Data, Json, show
from service.doctor import check_all


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
    show(checks, rows, as_json)
    if any(check.state == "failed" for check in checks):
        raise typer.Exit(1)
