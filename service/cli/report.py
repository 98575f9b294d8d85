"""`coastarc report`: the report of a campaign as files, or its numbers as JSON."""

import json
import re
from pathlib import Path
from typing import Annotated

import typer

from core.errors import UserError
from service.cli.options import DATA, Data
from service.store import Store

Campaign = Annotated[str, typer.Argument(help="Id of a campaign, or its name; the newest of that name.")]
Out = Annotated[Path | None, typer.Option(help="Folder to write to; report-NAME here if left out.")]
Json = Annotated[
    bool, typer.Option("--json", metavar="", help="Print the tables as JSON, and write nothing.")
]


class ReportError(UserError, RuntimeError):
    """A place that no report can be written to."""


def report(
    campaign: Campaign,
    data: Data = DATA,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Write the report of a campaign, finished or not: one HTML page, and its figures and tables."""
    # Drawing takes a second to import, and other commands do not draw.
    from service.report import tables_as_json, write_report

    with Store(data, read_only=True) as store:
        facts = store.campaign_facts(store.find_campaign(campaign))
    if as_json:
        typer.echo(json.dumps(tables_as_json(facts), indent=2, allow_nan=False))
        return
    folder = out or Path(folder_name(facts.name))
    try:
        path = write_report(facts, folder)
    except OSError as error:
        raise ReportError(
            f"report {folder}: expected a folder to write in, got {error.strerror}; name another with --out"
        ) from error
    typer.echo(f"Report: {path.resolve()}")


def folder_name(name: str) -> str:
    """Return the folder of a report: the campaign's name without what a file system may refuse."""
    return "report-" + (re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.") or "campaign")
