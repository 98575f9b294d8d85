"""What the pages of a search and of the workers look at."""

from collections.abc import Callable

from service.db.engine import Database
from service.scheduler.plan import LeaseSettings
from service.schemas.job import AttemptPage, AttemptsOfJob, QueueView
from service.schemas.search import HopsView, SearchDetail
from service.store import attempts, hops, one_search, queue

#: Bars or points of one picture, at most.
MOST = 5000
#: Window of attempts where none is asked for [s].
WINDOW_S = 900.0


class Activity:
    """Searches hop by hop, attempts and the queue of one archive."""

    def __init__(self, database: Database, clock: Callable[[], float], leases: LeaseSettings) -> None:
        self._database = database
        self._clock = clock
        self._leases = leases

    def search(self, campaign_id: int, name: str) -> SearchDetail:
        """Return a search of a campaign."""
        with self._database.read() as session:
            return one_search.get_search(session, campaign_id, name)

    def hops(self, campaign_id: int, name: str, limit: int = MOST, after: int = 0) -> HopsView:
        """Return the solves of a search, or of whole chains of it."""
        with self._database.read() as session:
            return hops.hops_of_search(session, campaign_id, name, limit, after)

    def attempts(self, since: float | None, until: float | None, limit: int = MOST) -> AttemptPage:
        """Return the attempts of a window, which ends now and is a quarter of an hour if not told."""
        end = self._clock() if until is None else until
        begin = end - WINDOW_S if since is None else since
        with self._database.read() as session:
            return attempts.attempts_between(session, begin, end, limit)

    def attempts_of_job(self, job_id: int) -> AttemptsOfJob:
        """Return the attempts at a job."""
        with self._database.read() as session:
            return attempts.attempts_of_job(session, job_id)

    def queue(self) -> QueueView:
        """Return what waits, runs and was given up."""
        with self._database.read() as session:
            return queue.get_queue(session, self._clock(), self._leases)
