"""`coastarc status`: campaigns, workers and dead jobs, or one campaign with its searches."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Protocol

import typer

from service.cli import terminal
from service.cli.options import DATA, Data, Json, MaybeUrl, client_of, console, print_json
from service.db.transitions import ENDED
from service.schemas.answer import Answer
from service.schemas.campaign import CampaignItem, CampaignView
from service.schemas.job import JobPage, JobView, WorkerPage, WorkerView
from service.store.archive import Archive

#: Dead jobs that are listed.
MOST_DEAD = 20


class Readable(Protocol):
    """A coordinator or an archive."""

    def campaigns(self) -> list[CampaignItem]:
        """Return the campaigns."""

    def campaign(self, campaign_id: int) -> CampaignView:
        """Return a campaign."""

    def find_campaign(self, name_or_id: str) -> int:
        """Return the newest campaign of a name, or else that of an id."""

    def workers(self) -> WorkerPage:
        """Return the workers."""

    def jobs(self, campaign: int | None, search: str | None, state: str | None, limit: int) -> JobPage:
        """Return a page of jobs."""


class Status(Answer):
    """An overview: what `coastarc status --json` prints."""

    #: Those that have not ended come with searches, rate and time left.
    campaigns: list[CampaignView | CampaignItem]
    #: Those seen within the time of a lease, with the leases of their jobs.
    workers: list[WorkerView]
    #: The first of those that will not be retried.
    dead_jobs: list[JobView]


class CampaignStatus(CampaignView):
    """One campaign: what `coastarc status --campaign ID --json` prints."""

    dead_jobs: list[JobView]


@contextmanager
def readable(data: Data, url: str | None) -> Iterator[Readable]:
    """Open the coordinator if one is named, or else the archive."""
    if url is not None:
        with client_of(url) as client:
            yield client
    else:
        with Archive(data) as store:
            yield store


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
        console.print(terminal.worker_list(found.workers) if found.workers else "No workers.")
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
    # Rates are computed at each request, so only for campaigns that have not ended.
    return source.campaign(item.id) if item.state not in ENDED else item
