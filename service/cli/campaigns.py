"""`coastarc campaigns`: a campaign as one file that another installation takes in."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from service.archive_format.container import PortableError
from service.cli.control import Readable, readable
from service.cli.options import DATA, Data, Json, MaybeUrl, client_of, console, print_json
from service.client import Client
from service.coordinator.lock import FolderLock, LockError
from service.db.place import make_folder
from service.new_file import write_new
from service.schemas.campaign import TakenInView
from service.store import Store
from service.store.archive_files import file_name, portable, take_in_file

campaigns = typer.Typer(help="Take campaigns from one installation to another.", no_args_is_help=True)

Campaign = Annotated[str, typer.Argument(help="Id of a campaign, or its name; the newest of that name.")]
Url = Annotated[
    str | None,
    typer.Option(help="Have this coordinator take it in, instead of the archive.", envvar="COASTARC_URL"),
]
Output = Annotated[
    Path | None, typer.Option("--output", "-o", help="New file; named after the campaign if left out.")
]


@campaigns.command("export")
def export_campaign(
    campaign: Campaign,
    output: Output = None,
    data: Data = DATA,
    url: MaybeUrl = None,
    as_json: Json = False,
) -> None:
    """Write a campaign that is paused or has ended to one file, with all campaigns that seed it."""
    with readable(data, url) as source:
        campaign_id = source.find_campaign(campaign)
        path = output or Path(file_name(source.campaign(campaign_id).name))
        n_bytes = write_new(path, _content(source, campaign_id))
    if as_json:
        print_json({"file": str(path), "bytes": n_bytes, "campaign_id": campaign_id})
    else:
        console.print(f"File: {path}, {n_bytes / 1e6:.2f} MB", highlight=False, markup=False)


def _content(source: Readable, campaign_id: int) -> Iterator[bytes]:
    if isinstance(source, Client):
        return source.export_campaign(campaign_id)
    assert isinstance(source, Store)
    return portable(source, campaign_id)


@campaigns.command("import")
def import_campaign(
    file: Annotated[Path, typer.Argument(help="File of `coastarc campaigns export`.")],
    data: Data = DATA,
    url: Url = None,
    as_json: Json = False,
) -> None:
    """Take in a campaign from such a file: all of it, or nothing; what is there already stays as it is."""
    taken = _sent(url, file) if url is not None else _taken_in(data, file)
    if as_json:
        print_json(taken)
        return
    console.print(f"Campaign {taken.campaign_id}: {_news(taken)}.", highlight=False, markup=False)


def _news(taken: TakenInView) -> str:
    certificates = f"{taken.n_certificates} new certificates" if taken.n_certificates else ""
    if not taken.new_campaigns:
        return certificates or "nothing is new, all of it was there"
    names = ", ".join(taken.new_campaigns)
    news = f"{names} taken in, with {taken.n_solves} solves and {taken.n_solutions} new solutions"
    return f"{news}, {certificates}" if certificates else news


def _sent(url: str, file: Path) -> TakenInView:
    with client_of(url) as client:
        return client.import_campaign(file)


def _taken_in(data: Path, file: Path) -> TakenInView:
    make_folder(data)
    try:
        with FolderLock(data), Store(data) as store:
            return TakenInView(**take_in_file(store, file)._asdict())
    except LockError as error:
        raise PortableError(f"{error}, or have that coordinator take it in with --url") from None
