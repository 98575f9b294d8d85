"""`coastarc report`, a campaign's report as files or JSON, and `coastarc example`, the paper's example."""

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from core.errors import UserError
from service.cli import terminal
from service.cli.options import DATA, Data, Json, console, print_json
from service.new_file import require_folder
from service.store.store import Store

if TYPE_CHECKING:
    from service.report.paper.motivating import MotivatingView


Campaign = Annotated[str, typer.Argument(help="Id of a campaign, or its name; the newest of that name.")]
Out = Annotated[Path | None, typer.Option(help="Folder to write to; report-NAME here if left out.")]
StatisticsJson = Annotated[
    bool, typer.Option("--json", metavar="", help="Print the tables as JSON, and write nothing.")
]


class ReportError(UserError, RuntimeError):
    """A place to which no report can be written."""


def report(
    campaign: Campaign,
    data: Data = DATA,
    out: Out = None,
    as_json: StatisticsJson = False,
) -> None:
    """Write the report of a campaign, finished or not: one HTML page, and its figures and tables."""
    # Importing matplotlib takes a second.
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
    """Return the folder of a report: the campaign's name without characters that a file system may refuse."""
    return "report-" + (re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.") or "campaign")


#: Rows of the table: label, field and digits.
ROWS = (
    ("propellant with the spiral, kg", "propellant_total_kg", 1),
    ("propellant of the transfer, kg", "propellant_kg", 1),
    ("delivered, kg", "final_mass_kg", 1),
    ("transfer to the end of the last burn, days", "transfer_days", 2),
    ("flight with the spiral, days", "flight_days", 2),
    ("mean throttle from the outage on", "mean_throttle", 3),
    ("position defect by the verifier, km", "position_defect_km", 5),
)


class ExampleError(UserError, RuntimeError):
    """An example whose solve failed on this machine."""


example = typer.Typer(help="Run an example from end to end.", no_args_is_help=True)

FigureFolder = Annotated[Path, typer.Option(help="Folder for the figure, as SVG and as PNG.")]


@example.callback()
def _examples() -> None:
    """Keep the name of the only subcommand."""


@example.command("motivating")
def motivating_command(out: FigureFolder = Path("motivating"), as_json: Json = False) -> None:
    """Solve a nominal transfer, lose its first burn to an outage of 60 hours, and recover.

    This is the example that the paper begins with; it takes a quarter of a minute. With --json it prints the
    numbers and draws nothing.
    """
    # Importing it takes seconds, which other commands need not wait for.
    from service.report.paper.motivating import ExampleFailedError, motivating

    if not as_json:
        require_folder(out)
    try:
        found = motivating()
    except ExampleFailedError as error:
        raise ExampleError(str(error)) from error
    if as_json:
        print_json(found.view)
        return
    from service.report.paper.motivating import write_motivating

    console.print(_table(found.view))
    for path in write_motivating(found.flight, out):
        console.print(f"Figure: {path.resolve()}", highlight=False, soft_wrap=True, markup=False)


def _table(view: "MotivatingView") -> Table:
    begun = view.outage_epoch[:16].replace("T", " ")
    title = f"Outage of {24 * view.outage_days:g} h at segment {view.outage_segment}, from {begun} on"
    rows = terminal.table("", "nominal", "under the outage", "change", title=title)
    for words, name, digits in ROWS:
        pair = [float(getattr(side, name)) for side in (view.nominal, view.recovered)]
        rows.add_row(words, *(f"{one:.{digits}f}" for one in pair), f"{pair[1] - pair[0]:+.{digits}f}")
    ends = [side.last_burn_epoch[:16].replace("T", " ") for side in (view.nominal, view.recovered)]
    rows.add_row("last burn ends, TDB", *ends, "")
    return rows
