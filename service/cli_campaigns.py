"""`coastarc campaigns`: a campaign as one file that another installation takes in."""

from pathlib import Path
from typing import Annotated

import typer

from service.cli_options import DATA, Data, Json, console, print_json
from service.db.place import make_folder
from service.new_file import write_new
from service.portable.files import file_name, packed, pieces, take_in_file
from service.store import Store
from service.store.portable_import import TakenIn

campaigns = typer.Typer(help="Take campaigns from one installation to another.", no_args_is_help=True)

Campaign = Annotated[str, typer.Argument(help="Id of a campaign, or its name; the newest of that name.")]
Output = Annotated[
    Path | None, typer.Option("--output", "-o", help="New file; named after the campaign if left out.")
]


@campaigns.command("export")
def export_campaign(
    campaign: Campaign, output: Output = None, data: Data = DATA, as_json: Json = False
) -> None:
    """Write a campaign that is paused or has ended to one file, with all campaigns that seed it."""
    with Store(data, read_only=True) as store:
        campaign_id = store.find_campaign(campaign)
        name = store.campaign(campaign_id).name
        path = output or Path(file_name(name))
        with packed(store, campaign_id) as draft:
            n_bytes = write_new(path, pieces(draft))
    if as_json:
        print_json({"file": str(path), "bytes": n_bytes, "campaign_id": campaign_id})
    else:
        console.print(f"File: {path}, {n_bytes / 1e6:.2f} MB", highlight=False, markup=False)


@campaigns.command("import")
def import_campaign(
    file: Annotated[Path, typer.Argument(help="File of `coastarc campaigns export`.")],
    data: Data = DATA,
    as_json: Json = False,
) -> None:
    """Take in a campaign from such a file: all of it, or nothing; what is there already stays as it is."""
    make_folder(data)
    with Store(data) as store:
        taken = take_in_file(store, file)
    if as_json:
        print_json(taken._asdict())
        return
    console.print(f"Campaign {taken.campaign_id}: {_news(taken)}.", highlight=False, markup=False)


def _news(taken: TakenIn) -> str:
    certificates = f"{taken.n_certificates} new certificates" if taken.n_certificates else ""
    if not taken.new_campaigns:
        return certificates or "nothing is new, all of it was there"
    names = ", ".join(taken.new_campaigns)
    news = f"{names} taken in, with {taken.n_solves} solves and {taken.n_solutions} new solutions"
    return f"{news}, {certificates}" if certificates else news
