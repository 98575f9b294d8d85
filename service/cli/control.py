"""Commands that ask a coordinator: pause, resume, cancel, share and watch."""

import time
from collections.abc import Iterator
from typing import Annotated

import typer
from rich.live import Live

from service.cli import terminal
from service.cli.command import print_error
from service.cli.options import DEFAULT_URL, Json, Url, client_of, console, print_json
from service.client import Client, ClientError, Verb
from service.db.transitions import ENDED
from service.schemas.campaign import CampaignView
from service.schemas.job import EventView
from workers.client import PASSING

Campaign = Annotated[str, typer.Argument(help="Id or name of a campaign.")]
Search = Annotated[str | None, typer.Option(help="Only this search of it.")]
#: Shortest period of reading a campaign, and how long a coordinator may be unreachable [s].
PERIOD_S, PATIENCE_S = 1.0, 30.0


def pause(campaign: Campaign, search: Search = None, url: Url = DEFAULT_URL, as_json: Json = False) -> None:
    """Stop handing out jobs of a campaign or of one search; running jobs finish."""
    _control("pause", campaign, search, url, as_json)


def resume(campaign: Campaign, search: Search = None, url: Url = DEFAULT_URL, as_json: Json = False) -> None:
    """Resume a paused campaign, or one search of it."""
    _control("resume", campaign, search, url, as_json)


def cancel(campaign: Campaign, search: Search = None, url: Url = DEFAULT_URL, as_json: Json = False) -> None:
    """End a campaign, or one search of it, for good; running solves are stopped, results are kept."""
    _control("cancel", campaign, search, url, as_json)


def _control(verb: Verb, campaign: str, search: str | None, url: str, as_json: bool) -> None:
    with client_of(url) as client:
        campaign_id = client.find_campaign(campaign)
        if search is None:
            view = client.control_campaign(campaign_id, verb)
        else:
            view = client.control_search(campaign_id, search, verb)
    if as_json:
        print_json(view)
        return
    thing, state = f"Campaign {view.id} ({view.name})", str(view.state)
    selected = [item for item in view.searches if search in (None, item.name)]
    if search is not None:
        thing, state = f"Search {search} of campaign {view.id} ({view.name})", selected[0].state
    n_running = sum(item.jobs.running for item in selected)
    running = f"; {n_running} jobs still run" if n_running and verb != "resume" else ""
    console.print(f"{thing} is {state}{running}.", highlight=False, markup=False)


def share(
    campaign: Campaign,
    search: Search = None,
    weight: Annotated[
        float | None,
        typer.Option(
            min=1e-3, max=1e6, help="Relative share of the workers among searches of equal priority."
        ),
    ] = None,
    priority: Annotated[
        int | None, typer.Option(min=-1_000_000, max=1_000_000, help="Lower goes first.")
    ] = None,
    url: Url = DEFAULT_URL,
    as_json: Json = False,
) -> None:
    """Set the priority and weight by which a campaign or one search shares the workers."""
    if weight is priority is None:
        raise ClientError("share: expected --weight, --priority or both, got neither")
    if weight is not None and search is None:
        raise ClientError("share: expected --search beside --weight, got none; a campaign has none")
    with client_of(url) as client:
        campaign_id = client.find_campaign(campaign)
        if search is not None and weight is not None:
            client.set_search_weight(campaign_id, search, weight)
        if priority is not None and search is not None:
            client.set_search_priority(campaign_id, search, priority)
        elif priority is not None:
            client.set_campaign_priority(campaign_id, priority)
        view = client.campaign(campaign_id)
    print_json(view) if as_json else console.print(terminal.shares(view))


def watch(campaign: Campaign, url: Url = DEFAULT_URL, as_json: Json = False) -> None:
    """Follow a campaign until it ends; with --json as one event a line."""
    with client_of(url) as client:
        campaign_id = client.find_campaign(campaign)
        if as_json:
            for event in events_of(client, campaign_id):
                typer.echo(event.model_dump_json())
        else:
            _watch(client, campaign_id)


def _watch(client: Client, campaign_id: int) -> None:
    view = client.campaign(campaign_id)
    with Live(terminal.progress(view), console=console, transient=True, auto_refresh=False) as live:
        for _ in events_of(client, campaign_id):
            began = time.monotonic()
            view = _current(client, campaign_id) or view
            if console.is_terminal:
                live.update(terminal.progress(view), refresh=True)
            time.sleep(max(0.0, began + PERIOD_S - time.monotonic()))
    console.print(terminal.summary(client.campaign(campaign_id)))


def _current(client: Client, campaign_id: int) -> CampaignView | None:
    """Return a campaign as it is now, or None while the coordinator is unavailable."""
    try:
        return client.campaign(campaign_id)
    except ClientError as error:
        if error.status in (None, *PASSING):
            return None
        raise


def events_of(client: Client, campaign_id: int) -> Iterator[EventView]:
    """Yield the events of a campaign until it ends: streamed, or polled where there is no stream.

    Of a campaign that has ended there is the last event alone.
    """
    last: int | None = None
    last_contact = time.monotonic()
    is_waiting = False
    while True:
        try:
            for event in _newer(client, campaign_id, last):
                last, last_contact = event.id, time.monotonic()
                yield event
                if event.kind == "campaign" and event.data.get("state") in ENDED:
                    break
            if client.campaign(campaign_id).state in ENDED:
                return
            last_contact, is_waiting = time.monotonic(), False
        except ClientError as error:
            if error.status in PASSING:
                # The coordinator answers but its archive does not, which may last: report once and wait.
                if not is_waiting:
                    print_error(f"{error}; waiting until it is available again")
                last_contact, is_waiting = time.monotonic(), True
            elif error.status is not None or time.monotonic() - last_contact > PATIENCE_S:
                # For less than that a coordinator may be restarting; it continues where it was.
                raise
        time.sleep(PERIOD_S)


def _newer(client: Client, campaign_id: int, last: int | None) -> Iterator[EventView]:
    """Yield events until the stream ends; poll once where a stream is refused or breaks."""
    try:
        for event in client.follow(campaign_id, last):
            last = event.id
            yield event
    except ClientError:
        yield from client.events(last or 0, campaign_id)
