"""Read access to an archive: campaigns, jobs, workers, solutions, certificates and tokens.

Nothing here needs the numerics, so that lists of the command line cost little; `service.store.store` adds
all that changes campaigns or computes something of them.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

from sqlalchemy.orm import Session

from service.db.engine import Database, place_of
from service.db.postgres import server_time
from service.scheduler import LeaseSettings
from service.schemas.campaign import CampaignItem, CampaignView
from service.schemas.job import JobPage, WorkerPage
from service.schemas.solution import Filter, RecordInFull, RecordWithVector
from service.store import campaigns, filters, jobs, solutions, workers
from service.store.filters import Order
from service.store.identity import Identities
from service.store.solutions import Certificates
from workers.retry import Downtime


class Archive:
    """What is stored in one data folder; every call is one transaction."""

    def __init__(
        self,
        folder: Path,
        *,
        read_only: bool = True,
        clock: Callable[[], float] | None = None,
        leases: LeaseSettings = LeaseSettings(),  # noqa: B008
    ) -> None:
        self.folder = folder
        self.leases = leases
        place = place_of(folder)
        self._database = Database(place, read_only=read_only)
        self._clock = clock or time.time
        # Several coordinators on one database must mean the same by a moment, whatever their machines say.
        self._is_clock_shared = clock is None and not isinstance(place, Path)
        self._ahead_s = 0.0
        #: Certificates of solutions.
        self.certificates = Certificates(self._database)
        #: Who may use the archive, and who did what.
        self.identities = Identities(self._database, self._clock)

    def __enter__(self) -> Self:
        """Give the store; it is closed at the end of the block."""
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the archive."""
        self._database.close()

    @property
    def downtime(self) -> Downtime:
        """What is said of an archive that cannot be used for a while."""
        return self._database.downtime

    def campaigns(self) -> list[CampaignItem]:
        """Return the campaigns, the newest first."""
        with self._database.read() as session:
            return campaigns.list_campaigns(session)

    def campaign(self, campaign_id: int) -> CampaignView:
        """Return a campaign with its searches."""
        with self._database.read() as session:
            return campaigns.get_campaign(session, campaign_id, self._now(session))

    def campaign_state(self, campaign_id: int) -> str:
        """Return the state of a campaign alone."""
        with self._database.read() as session:
            return filters.campaign_state(session, campaign_id)

    def find_campaign(self, name_or_id: str) -> int:
        """Return the newest campaign of a name, or else that of an id."""
        with self._database.read() as session:
            return filters.find_campaign(session, name_or_id)

    def all_records(
        self,
        wanted: Filter,
        limit: int | None = None,
        order: Order = Order(),  # noqa: B008
    ) -> list[RecordWithVector]:
        """Return the solutions of a filter with their vectors, all or the first so many."""
        with self._database.read() as session:
            return solutions.all_records(session, wanted, order, limit)

    def record(self, solution_id: str) -> RecordInFull:
        """Return a solution."""
        with self._database.read() as session:
            return solutions.get_record(session, solution_id)

    def find_solution(self, prefix: str) -> str:
        """Return the id that begins with a prefix."""
        with self._database.read() as session:
            return solutions.find_id(session, prefix)

    def jobs(
        self, campaign: int | None, search: str | None, state: str | None, limit: int, after: int = 0
    ) -> JobPage:
        """Return a page of jobs."""
        with self._database.read() as session:
            return jobs.list_jobs(session, campaign, search, state, limit, after)

    def workers(self) -> WorkerPage:
        """Return the workers that have registered, with the jobs that they hold."""
        with self._database.read() as session:
            return workers.list_workers(session, self._now(session), self.leases.lease_s)

    def _now(self, session: Session) -> float:
        return server_time(session) if self._is_clock_shared else self._clock()

    def _about_now(self) -> float:
        """Return the same without a question, as good as it was when it was last asked for."""
        return self._clock() + (self._ahead_s if self._is_clock_shared else 0.0)
