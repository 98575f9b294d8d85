"""The archive behind one narrow interface; every call is one transaction."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import numpy as np
from sqlalchemy import text

from core.analysis.facts import CampaignFacts
from service.api import schemas
from service.db.engine import Database
from service.spec import Spec
from service.store import catalogue, dispatch, events, facts, find, progress, records, submission
from service.store.errors import StoreError, UnknownRow
from service.store.records import Filter
from workers.executor import Ticket
from workers.job import Claim, JobOutcome

__all__ = ["Store", "StoreError", "UnknownRow"]

FILE_NAME = "coastarc.db"


class Store:
    """Campaigns, jobs and solutions in one data folder."""

    def __init__(
        self, folder: Path, *, read_only: bool = False, clock: Callable[[], float] = time.time
    ) -> None:
        self.folder = folder
        self._clock = clock
        self._database = Database(folder / FILE_NAME, read_only=read_only)

    def __enter__(self) -> Self:
        """Give the store; it is closed at the end of the block."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the archive."""
        self.close()

    def close(self) -> None:
        """Close the archive."""
        self._database.close()

    # What changes the archive.

    def submit(self, spec: Spec) -> tuple[int, bool]:
        """Return the campaign of a specification, and whether it is new."""
        return self._database.write(lambda session: submission.submit(session, spec, self._clock()))

    def recover(self) -> int:
        """Put back the jobs of a process that is gone; return how many."""
        return self._database.write(lambda session: dispatch.recover(session, self._clock()))

    def revive(self, campaign_id: int) -> int:
        """Put back the jobs of a campaign that were given up; return how many."""
        return self._database.write(lambda session: dispatch.revive(session, campaign_id, self._clock()))

    def claim(self, worker: str, n_jobs: int, campaign: int | None = None) -> list[Claim]:
        """Hand out jobs of one campaign, or of all."""
        now = self._clock()
        return self._database.write(lambda session: dispatch.claim(session, worker, n_jobs, campaign, now))

    def complete(self, ticket: Ticket, outcome: JobOutcome) -> None:
        """Take back an outcome; a stale one raises and changes nothing."""
        self._database.write(lambda session: dispatch.complete(session, ticket, outcome, self._clock()))

    # What reads it.

    def campaigns(self) -> list[schemas.CampaignItem]:
        """Return the campaigns, the newest first."""
        with self._database.read() as session:
            return progress.list_campaigns(session)

    def campaign(self, campaign_id: int) -> schemas.CampaignView:
        """Return a campaign with its searches."""
        with self._database.read() as session:
            return progress.get_campaign(session, campaign_id, self._clock())

    def campaign_state(self, campaign_id: int) -> str:
        """Return the state of a campaign alone."""
        with self._database.read() as session:
            return find.campaign_state(session, campaign_id)

    def campaign_facts(self, campaign_id: int) -> CampaignFacts:
        """Return the facts that the metrics of a campaign are made from."""
        with self._database.read() as session:
            return facts.campaign_facts(session, campaign_id)

    def find_campaign(self, name_or_id: str) -> int:
        """Return the campaign of an id, or the newest of a name."""
        with self._database.read() as session:
            return find.find_campaign(session, name_or_id)

    def records(self, wanted: Filter, limit: int, after: str | None = None) -> schemas.RecordPage:
        """Return a page of solutions."""
        with self._database.read() as session:
            return records.list_records(session, wanted, limit, after)

    def all_records(self, wanted: Filter, limit: int | None = None) -> list[schemas.RecordWithVector]:
        """Return the solutions of a filter with their vectors, all or the best so many."""
        with self._database.read() as session:
            return records.all_records(session, wanted, limit)

    def record(self, solution_id: str) -> schemas.RecordWithVector:
        """Return a solution."""
        with self._database.read() as session:
            return records.get_record(session, solution_id)

    def find_solution(self, prefix: str) -> str:
        """Return the id that begins with a prefix."""
        with self._database.read() as session:
            return records.find_id(session, prefix)

    def definition_and_vector(self, solution_id: str) -> tuple[dict[str, Any], np.ndarray[Any, Any]]:
        """Return the problem of a solution as plain data, and its vector."""
        with self._database.read() as session:
            return records.definition_and_vector(session, solution_id)

    def lineage(self, solution_id: str) -> schemas.Lineage:
        """Return the seeds behind a solution."""
        with self._database.read() as session:
            return records.lineage(session, solution_id)

    def problems(self) -> schemas.ProblemPage:
        """Return the problems."""
        with self._database.read() as session:
            return catalogue.list_problems(session)

    def problem(self, problem_hash: str) -> schemas.ProblemView:
        """Return a problem."""
        with self._database.read() as session:
            return catalogue.get_problem(session, problem_hash)

    def jobs(
        self, campaign: int | None, search: str | None, state: str | None, limit: int, after: int = 0
    ) -> schemas.JobPage:
        """Return a page of jobs."""
        with self._database.read() as session:
            return catalogue.list_jobs(session, campaign, search, state, limit, after)

    def events(self, after: int, campaign: int | None = None, limit: int = 200) -> list[schemas.EventView]:
        """Return the events that follow an id."""
        with self._database.read() as session:
            return events.events_after(session, after, campaign, limit)

    def last_event_id(self, campaign: int) -> int:
        """Return the id of the latest event of a campaign, or 0."""
        with self._database.read() as session:
            return events.last_event_id(session, campaign)

    def check(self) -> None:
        """Raise unless the archive can be read and written."""
        self._database.write(lambda session: session.execute(text("SELECT 1")))
