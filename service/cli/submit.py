"""`coastarc submit`: a campaign for a running coordinator."""

from typing import Annotated

import typer

from service.cli.options import DEFAULT_URL, Json, SpecFile, Url, client_of, console, print_json
from service.spec import load_spec


def submit(
    spec: SpecFile,
    url: Url = DEFAULT_URL,
    key: Annotated[
        str | None, typer.Option(help="Any text; repeated with it, a submission counts once.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Submit a campaign to a running coordinator."""
    with client_of(url) as client:
        campaign, is_new = client.submit(load_spec(spec).as_fields(), key)
    if as_json:
        print_json(campaign)
    else:
        news = "submitted" if is_new else "is already there"
        console.print(f"Campaign {campaign.id} ({campaign.name}) {news}; watch it at {url}")
        is_planned = all(one.seeds_from or one.state != "waiting" for one in campaign.searches)
        if is_new and not is_planned:
            console.print("It is large: its searches wait while the coordinator plans one after the other.")
