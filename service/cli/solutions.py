"""`coastarc solutions`: look at solutions, find them again, take them away."""

from typing import Annotated

import typer

from service.cli import terminal
from service.cli.export import export_command
from service.cli.options import DATA, Data, Json, console, print_json, show
from service.cli.refine import refine_command
from service.cli.reproduce import reproduce_command
from service.cli.terminal_record import print_record
from service.cli.terminal_verify import print_certificate
from service.cli.verify import verify_command
from service.store import Store
from service.store.filters import Order, Sort, filter_of

CampaignName = Annotated[str | None, typer.Option(help="Id or name of a campaign.")]

solutions = typer.Typer(help="Look at solutions, find them again, take them away.", no_args_is_help=True)


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
    limit: Annotated[
        int | None, typer.Option(min=1, max=10**9, help="At most so many, the first by --sort.")
    ] = None,
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
        show(records, terminal.solution_list(records), as_json)
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
        print_record(console, record)
        print_certificate(console, certificate)


solutions.command("reproduce")(reproduce_command)
solutions.command("verify")(verify_command)
solutions.command("refine")(refine_command)
solutions.command("export")(export_command)
