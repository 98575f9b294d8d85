"""`coastarc solutions`: list and show them; `solution_commands` has what needs the numerics."""

from typing import Annotated

import typer

from service.cli import terminal
from service.cli.options import (
    DATA,
    Data,
    Json,
    console,
    print_json,
    show,
)
from service.cli.terminal import (
    print_certificate,
    print_record,
)
from service.store.archive import Archive
from service.store.filters import Order, Sort, filter_of

#: Commands that propagate or solve, imported when they are typed: where each is, and what it is for.
LATER = {
    "reproduce": (
        "service.cli.solution_commands:reproduce_command",
        "Rerun the job of a solution on this machine and compare every bit; exit code 1 if one differs.",
    ),
    "verify": (
        "service.cli.solution_commands:verify_command",
        "Verify solutions by an independent integrator, and store a certificate of each.",
    ),
    "refine": (
        "service.cli.solution_commands:refine_command",
        "Solve a solution again in more segments, each step from the one before, and show the gain in mass.",
    ),
    "export": (
        "service.cli.solution_commands:export_command",
        "Write the reference, a realization or all of them as SPK, OEM, CSV or NDJSON.",
    ),
}

CampaignName = Annotated[str | None, typer.Option(help="Id or name of a campaign.")]

solutions = typer.Typer(
    help="List, show, verify, reproduce, refine and export solutions.", no_args_is_help=True
)


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
        typer.Option("--strict/--paper-only", metavar="", help="Only strict solutions, or only loose ones."),
    ] = None,
    sort: Annotated[Sort, typer.Option(help="What they are sorted by.")] = "objective_kg",
    limit: Annotated[
        int | None, typer.Option(min=1, max=10**9, help="At most so many, the first by --sort.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List verified solutions, the least propellant first unless --sort says otherwise."""
    with Archive(data) as store:
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
        console.print("No solution in this archive matches.")


@solutions.command("show")
def show_solution(
    solution: Annotated[str, typer.Argument(help="Id of a solution, or its beginning.")],
    data: Data = DATA,
    as_json: Json = False,
) -> None:
    """Show one solution and its certificate; its decision vector is in the JSON."""
    with Archive(data) as store:
        record = store.record(store.find_solution(solution))
        certificate = store.certificates.latest(record.id)
    if as_json:
        shown = certificate and certificate.model_dump(mode="json")
        print_json(record.model_dump(mode="json") | {"certificate": shown})
    else:
        print_record(console, record)
        print_certificate(console, certificate)
