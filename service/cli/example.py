"""`coastarc example`: what the paper begins with, run on this machine."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from core.errors import UserError
from service.cli import terminal
from service.cli.options import Json, console, print_json
from service.new_file import require_folder

if TYPE_CHECKING:
    from service.report.paper.motivating import MotivatingView

#: What is shown of both sides: words, field and digits.
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
    """An example that did not come out on this machine."""


example = typer.Typer(help="Run an example from end to end.", no_args_is_help=True)

Out = Annotated[Path, typer.Option(help="Folder for the figure, as SVG and as PNG.")]


@example.callback()
def _root() -> None:
    """Keep the name of the one command."""


@example.command("motivating")
def motivating_command(out: Out = Path("motivating"), as_json: Json = False) -> None:
    """Fly a nominal transfer, lose its first burn to an outage of 60 hours, and recover.

    This is the example that the paper begins with; it takes a quarter of a minute. With --json it prints the
    numbers and draws nothing.
    """
    # Its imports take seconds, which the other commands need not wait for.
    from service.report.paper.motivating import NoExample, motivating

    if not as_json:
        require_folder(out)
    try:
        found = motivating()
    except NoExample as error:
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
