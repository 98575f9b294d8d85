"""`coastarc campaigns`, campaigns as files, and `coastarc seeds`, the seeds of a search or a problem."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

import typer

from service.archive_format.container import PortableError
from service.cli import terminal
from service.cli.options import DATA, Data, Json, MaybeUrl, client_of, console, print_json
from service.client import Client, ClientError
from service.coordinator.lock import FolderLock, LockError
from service.db.engine import make_folder
from service.new_file import write_new
from service.schemas.campaign import ImportView
from service.spec.search_spec import SeedOrder
from service.spec.spec import SeedChoices
from service.store.archive_files import file_name, import_file, portable
from service.store.store import Store


def _source(data: Path, url: str | None) -> Client | Store:
    """Return the coordinator if one is named, or else the archive."""
    return client_of(url) if url is not None else Store(data, read_only=True)


def seeds(
    data: Data = DATA,
    url: MaybeUrl = None,
    campaign: Annotated[str | None, typer.Option(help="Campaign of the search to be seeded.")] = None,
    search: Annotated[str | None, typer.Option(help="Search to be seeded.")] = None,
    problem: Annotated[str | None, typer.Option(help="Hash of a problem to be seeded instead.")] = None,
    outage: Annotated[
        list[str] | None,
        typer.Option(help="Outage instead of the problem's, as segment:days; may be repeated."),
    ] = None,
    k: Annotated[int | None, typer.Option(min=0, help="Number of outages that the seeds survive.")] = None,
    order: Annotated[
        SeedOrder | None,
        typer.Option(help="Which seeds go first."),
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, max=200, help="At most so many seeds.")] = None,
    tolerance: Annotated[
        Literal["strict", "paper"] | None,
        typer.Option(help="Tolerance that seeds must meet; paper is the loose one."),
    ] = None,
    mapping: Annotated[
        list[str] | None, typer.Option(help="Rule that makes guesses; may be repeated.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Show which solutions would seed a search or a problem, and by which mapping."""
    wanted = SeedChoices(order, limit, tolerance, tuple(mapping) if mapping else None)
    with _source(data, url) as source:
        if problem is not None and campaign is None and search is None:
            outages = [_outage(text) for text in outage] if outage else None
            page = source.seeds_of_problem(problem, outages, k, wanted)
        elif problem is None and campaign is not None and search is not None and not outage and k is None:
            page = source.seeds_of_search(source.find_campaign(campaign), search, wanted)
        else:
            raise ClientError(
                "seeds: expected --campaign and --search, or --problem with --outage and --k if wanted, "
                "got another mixture"
            )
    print_json(page) if as_json else console.print(terminal.seed_list(page))


def _outage(text: str) -> tuple[int, float]:
    segment, _, days = text.partition(":")
    try:
        return int(segment), float(days)
    except ValueError:
        raise ClientError(f"--outage: expected segment:days as in 24:1.0, got {text}") from None


campaigns = typer.Typer(help="Copy campaigns between installations.", no_args_is_help=True)

CampaignToExport = Annotated[
    str, typer.Argument(help="Id of a campaign, or its name; the newest of that name.")
]
UrlOfArchive = Annotated[
    str | None,
    typer.Option(help="Import into this coordinator, instead of the archive.", envvar="COASTARC_URL"),
]
Output = Annotated[
    Path | None, typer.Option("--output", "-o", help="New file; named after the campaign if left out.")
]


@campaigns.command("export")
def export_campaign(
    campaign: CampaignToExport,
    output: Output = None,
    data: Data = DATA,
    url: MaybeUrl = None,
    as_json: Json = False,
) -> None:
    """Write a campaign that is paused or has ended to one file, with all campaigns that seed it."""
    with _source(data, url) as source:
        campaign_id = source.find_campaign(campaign)
        path = output or Path(file_name(source.campaign(campaign_id).name))
        n_bytes = write_new(path, _content(source, campaign_id))
    if as_json:
        print_json({"file": str(path), "bytes": n_bytes, "campaign_id": campaign_id})
    else:
        console.print(f"File: {path}, {n_bytes / 1e6:.2f} MB", highlight=False, markup=False)


def _content(source: Client | Store, campaign_id: int) -> Iterator[bytes]:
    if isinstance(source, Client):
        return source.export_campaign(campaign_id)
    return portable(source, campaign_id)


@campaigns.command("import")
def import_campaign(
    file: Annotated[Path, typer.Argument(help="File of `coastarc campaigns export`.")],
    data: Data = DATA,
    url: UrlOfArchive = None,
    as_json: Json = False,
) -> None:
    """Import a campaign from such a file, all of it or nothing; existing rows stay unchanged."""
    imported = _upload(url, file) if url is not None else _import(data, file)
    if as_json:
        print_json(imported)
        return
    console.print(f"Campaign {imported.campaign_id}: {_changes(imported)}.", highlight=False, markup=False)


def _changes(imported: ImportView) -> str:
    certificates = f"{imported.n_certificates} new certificates" if imported.n_certificates else ""
    if not imported.new_campaigns:
        return certificates or "nothing new, all of it was there already"
    names = ", ".join(imported.new_campaigns)
    news = f"{names} imported, with {imported.n_solves} solves and {imported.n_solutions} new solutions"
    return f"{news}, {certificates}" if certificates else news


def _upload(url: str, file: Path) -> ImportView:
    with client_of(url) as client:
        return client.import_campaign(file)


def _import(data: Path, file: Path) -> ImportView:
    make_folder(data)
    try:
        with FolderLock(data), Store(data) as store:
            return ImportView(**import_file(store, file)._asdict())
    except LockError as error:
        raise PortableError(f"{error}, or import into that coordinator with --url") from None
