"""`coastarc campaigns`: a campaign as one file that another installation takes in.

Commands that steer and follow campaigns: they ask a coordinator, or read its archive.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Literal, Protocol

import typer
from rich.live import Live

from service.archive_format.container import PortableError
from service.cli import terminal
from service.cli.command import complain
from service.cli.options import DATA, DEFAULT_URL, Data, Json, MaybeUrl, Url, client_of, console, print_json
from service.client import Client, ClientError, Verb
from service.coordinator.lock import FolderLock, LockError
from service.db.engine import make_folder
from service.db.transitions import ENDED
from service.new_file import write_new
from service.schemas.answer import Answer
from service.schemas.campaign import CampaignItem, CampaignView, ImportView
from service.schemas.job import EventView, JobPage, JobView, WorkerPage, WorkerView
from service.schemas.solution import SeedPage
from service.spec.search_spec import SeedOrder
from service.spec.spec import SeedChoices
from service.store.archive_files import file_name, import_file, portable
from service.store.store import Store
from workers.client import PASSING

Campaign = Annotated[str, typer.Argument(help="Id or name of a campaign.")]
Search = Annotated[str | None, typer.Option(help="Only this search of it.")]
#: A campaign is read again this often at most; a coordinator may be away for so long [s].
PERIOD_S, PATIENCE_S = 1.0, 30.0
#: Dead jobs that are listed.
MOST_DEAD = 20


class Readable(Protocol):
    """A coordinator or an archive."""

    def campaigns(self) -> list[CampaignItem]:
        """Return the campaigns."""

    def campaign(self, campaign_id: int) -> CampaignView:
        """Return a campaign."""

    def find_campaign(self, name_or_id: str) -> int:
        """Return the campaign of an id, or the newest of a name."""

    def workers(self) -> WorkerPage:
        """Return the workers."""

    def jobs(self, campaign: int | None, search: str | None, state: str | None, limit: int) -> JobPage:
        """Return a page of jobs."""

    def seeds_of_search(self, campaign_id: int, search: str, wanted: SeedChoices) -> SeedPage:
        """Return what would seed a search."""

    def seeds_of_problem(
        self,
        problem_hash: str,
        outages: list[tuple[int, float]] | None,
        seed_k: int | None,
        wanted: SeedChoices,
    ) -> SeedPage:
        """Return what would seed a problem."""


class Status(Answer):
    """Everything at a glance: what `coastarc status --json` prints."""

    #: Those that may go on with their searches, rates and times left.
    campaigns: list[CampaignView | CampaignItem]
    #: Those seen within a lease, with the leases of what they hold.
    workers: list[WorkerView]
    #: The first of those given up.
    dead_jobs: list[JobView]


class CampaignStatus(CampaignView):
    """One campaign at a glance: what `coastarc status --campaign ID --json` prints."""

    dead_jobs: list[JobView]


@contextmanager
def readable(data: Data, url: str | None) -> Iterator[Readable]:
    """Give the coordinator if one is named, and else the archive."""
    if url is not None:
        with client_of(url) as client:
            yield client
    else:
        with Store(data, read_only=True) as store:
            yield store


def pause(campaign: Campaign, search: Search = None, url: Url = DEFAULT_URL, as_json: Json = False) -> None:
    """Hand out no more jobs of a campaign or of one search; those that run finish."""
    _control("pause", campaign, search, url, as_json)


def resume(campaign: Campaign, search: Search = None, url: Url = DEFAULT_URL, as_json: Json = False) -> None:
    """Let a paused campaign, or one search of it, go on."""
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
    meant = [item for item in view.searches if search in (None, item.name)]
    if search is not None:
        thing, state = f"Search {search} of campaign {view.id} ({view.name})", meant[0].state
    n_running = sum(item.jobs.running for item in meant)
    running = f"; {n_running} jobs still run" if n_running and verb != "resume" else ""
    console.print(f"{thing} is {state}{running}.", highlight=False, markup=False)


def share(
    campaign: Campaign,
    search: Search = None,
    weight: Annotated[
        float | None,
        typer.Option(
            min=1e-3, max=1e6, help="Part of the workers that a search gets, beside others of equal priority."
        ),
    ] = None,
    priority: Annotated[
        int | None, typer.Option(min=-1_000_000, max=1_000_000, help="Lower goes first.")
    ] = None,
    url: Url = DEFAULT_URL,
    as_json: Json = False,
) -> None:
    """Change when a campaign or one search of it gets workers, and how large a part of them."""
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


def status(
    data: Data = DATA,
    url: MaybeUrl = None,
    campaign: Annotated[str | None, typer.Option(help="Id or name of a campaign.")] = None,
    as_json: Json = False,
) -> None:
    """Show campaigns, workers and dead jobs, or one campaign with its searches."""
    with readable(data, url) as source:
        found = _everything(source) if campaign is None else _one(source, source.find_campaign(campaign))
    if as_json:
        print_json(found)
        return
    if isinstance(found, CampaignStatus):
        console.print(terminal.summary(found))
    else:
        console.print(terminal.campaign_list(found.campaigns))
        console.print(terminal.worker_list(found.workers) if found.workers else "No worker is there.")
    if found.dead_jobs:
        console.print(terminal.dead_jobs(found.dead_jobs))


def _everything(source: Readable) -> Status:
    return Status(
        campaigns=[_with_rate(source, item) for item in source.campaigns()],
        workers=[worker for worker in source.workers().items if worker.is_alive],
        dead_jobs=source.jobs(None, None, "dead", MOST_DEAD).items,
    )


def _one(source: Readable, campaign_id: int) -> CampaignStatus:
    dead = source.jobs(campaign_id, None, "dead", MOST_DEAD).items
    return CampaignStatus(**source.campaign(campaign_id).model_dump(), dead_jobs=dead)


def _with_rate(source: Readable, item: CampaignItem) -> CampaignView | CampaignItem:
    # Rates are counted anew for each question, so only where they say something.
    return source.campaign(item.id) if item.state not in ENDED else item


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
        Literal["strict", "paper"] | None, typer.Option(help="How feasible seeds must be.")
    ] = None,
    mapping: Annotated[
        list[str] | None, typer.Option(help="Rule that makes guesses; may be repeated.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Show which solutions would seed a search or a problem, and by which mapping."""
    wanted = SeedChoices(order, limit, tolerance, tuple(mapping) if mapping else None)
    with readable(data, url) as source:
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
            view = _seen(client, campaign_id) or view
            if console.is_terminal:
                live.update(terminal.progress(view), refresh=True)
            time.sleep(max(0.0, began + PERIOD_S - time.monotonic()))
    console.print(terminal.summary(client.campaign(campaign_id)))


def _seen(client: Client, campaign_id: int) -> CampaignView | None:
    """Return a campaign as it is now, or None where the coordinator cannot say."""
    try:
        return client.campaign(campaign_id)
    except ClientError as error:
        if error.status in (None, *PASSING):
            return None
        raise


def events_of(client: Client, campaign_id: int) -> Iterator[EventView]:
    """Return the events of a campaign until it ends: by a stream, and by asking where there is none.

    Whoever begins at a campaign that has ended gets its last event.
    """
    last: int | None = None
    heard = time.monotonic()
    is_away = False
    while True:
        try:
            for event in _newer(client, campaign_id, last):
                last, heard = event.id, time.monotonic()
                yield event
                if event.kind == "campaign" and event.data.get("state") in ENDED:
                    break
            if client.campaign(campaign_id).state in ENDED:
                return
            heard, is_away = time.monotonic(), False
        except ClientError as error:
            if error.status in PASSING:
                # It is there and its archive is not, which may last: said once, and waited for.
                if not is_away:
                    complain(f"{error}; waiting until it works again")
                heard, is_away = time.monotonic(), True
            elif error.status is not None or time.monotonic() - heard > PATIENCE_S:
                # A coordinator may be started anew meanwhile, and goes on where it was.
                raise
        time.sleep(PERIOD_S)


def _newer(client: Client, campaign_id: int, last: int | None) -> Iterator[EventView]:
    """Return events until the stream ends, or those of one question where a stream is refused or breaks."""
    try:
        for event in client.follow(campaign_id, last):
            last = event.id
            yield event
    except ClientError:
        yield from client.events(last or 0, campaign_id)


campaigns = typer.Typer(help="Take campaigns from one installation to another.", no_args_is_help=True)

CampaignToExport = Annotated[
    str, typer.Argument(help="Id of a campaign, or its name; the newest of that name.")
]
UrlOfArchive = Annotated[
    str | None,
    typer.Option(help="Have this coordinator take it in, instead of the archive.", envvar="COASTARC_URL"),
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
    url: UrlOfArchive = None,
    as_json: Json = False,
) -> None:
    """Take in a campaign from such a file: all of it, or nothing; what is there already stays as it is."""
    taken = _sent(url, file) if url is not None else _taken_in(data, file)
    if as_json:
        print_json(taken)
        return
    console.print(f"Campaign {taken.campaign_id}: {_news(taken)}.", highlight=False, markup=False)


def _news(taken: ImportView) -> str:
    certificates = f"{taken.n_certificates} new certificates" if taken.n_certificates else ""
    if not taken.new_campaigns:
        return certificates or "nothing is new, all of it was there"
    names = ", ".join(taken.new_campaigns)
    news = f"{names} taken in, with {taken.n_solves} solves and {taken.n_solutions} new solutions"
    return f"{news}, {certificates}" if certificates else news


def _sent(url: str, file: Path) -> ImportView:
    with client_of(url) as client:
        return client.import_campaign(file)


def _taken_in(data: Path, file: Path) -> ImportView:
    make_folder(data)
    try:
        with FolderLock(data), Store(data) as store:
            return ImportView(**import_file(store, file)._asdict())
    except LockError as error:
        raise PortableError(f"{error}, or have that coordinator take it in with --url") from None
