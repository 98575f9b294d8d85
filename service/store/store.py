"""The interface of an archive; every call is one transaction."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from sqlalchemy.orm import Session

from core.analysis.campaign_facts import CampaignFacts
from core.problem import Problem
from service.archive_format.container import Entry
from service.archive_format.reading import ReadFile
from service.scheduler import LeaseSettings
from service.schemas.campaign import CampaignCard, HistoryView
from service.schemas.job import EventView, JobView
from service.schemas.problem import ProblemFamily, ProblemPage, ProblemView
from service.schemas.solution import (
    ChoicesView,
    ClusterPage,
    Filter,
    LineageGraph,
    PointsView,
    RecordPage,
    RecordWithVector,
    Reproduction,
    SeedPage,
)
from service.spec import Spec
from service.spec.spec import SeedChoices
from service.store import (
    archive_io,
    campaign_history,
    campaigns,
    claims,
    completion,
    control,
    events,
    filters,
    jobs,
    leases,
    lineage,
    planning,
    scatter,
    solutions,
    statistics,
    workers,
)
from service.store.archive import Archive
from service.store.archive_io import ImportResult
from service.store.cache import spec_fields, spec_of
from service.store.campaign_history import HistoryCache
from service.store.control import Verb
from service.store.filters import Begin, Order
from service.store.jobs import Activity
from service.store.seeds import family, seeds_of_problem, seeds_of_search
from service.store.statistics import OperatorMetrics, require_writable
from workers.messages import (
    Claim,
    CompleteAnswer,
    CompleteRequest,
    HandInAnswer,
    HandInRequest,
    HeartbeatAnswer,
    JobOutcome,
    Ticket,
    WorkerInfo,
)

#: Between two pieces of one piece of work, so that who waits for the lock of writers gets it [s].
TURN_S = 0.005


class Store(Archive):
    """Campaigns, jobs and solutions in one data folder: all that may be asked of them and done to them.

    What campaigns, searches, jobs and solutions are asked and told is a method.  A subject of its own, with a
    class of its own, is an attribute: `certificates`, `gauges`, `activity` and `identities`.
    """

    def __init__(
        self,
        folder: Path,
        *,
        read_only: bool = False,
        clock: Callable[[], float] | None = None,
        leases: LeaseSettings = LeaseSettings(),  # noqa: B008
    ) -> None:
        super().__init__(folder, read_only=read_only, clock=clock, leases=leases)
        #: What operators watch.
        self.gauges = OperatorMetrics(self._database, self._about_now, leases.lease_s)
        #: Searches hop by hop, attempts and the queue.
        self.activity = Activity(self._database, self._about_now, leases)
        self._histories = HistoryCache(self._database)

    # What changes the archive.

    def submit(self, spec: Spec, key: str | None = None) -> tuple[int, bool]:
        """Return the campaign of a specification, and whether it is new; a key makes a repetition known."""
        campaign_id, is_new = self.begin_campaign(spec, key)
        self.plan_rest(campaign_id)
        return campaign_id, is_new

    def begin_campaign(self, spec: Spec, key: str | None = None) -> tuple[int, bool]:
        """Store a campaign as `submit`; the jobs of a large one are left to `plan_rest`.

        What takes long to make is made before a transaction begins, and problems are stored in transactions
        of their own: one that no campaign follows does no harm.
        """
        with self._database.read() as session:
            is_known = planning.is_known(session, spec, key)
        cases = None if is_known else planning.Cases(spec)
        if cases is not None and not cases.is_small:
            for piece in cases.pieces():
                self._database.write(partial(planning.add_problems, rows=piece))
                time.sleep(TURN_S)
        return self._database.write(
            lambda session: planning.submit(session, spec, self._now(session), key, cases)
        )

    def unplanned(self, campaign_id: int | None = None) -> list[int]:
        """Return the campaigns of which searches are still to be planned, all or the one if it is such."""
        with self._database.read() as session:
            return planning.unplanned(session, campaign_id)

    def plan_rest(self, campaign_id: int, is_stopped: Callable[[], bool] = lambda: False) -> None:
        """Plan what is left of a campaign, in transactions between which others have their turn."""
        while not is_stopped() and self.unplanned(campaign_id):
            # To parse a long one takes a second: not inside of the transaction that needs it.
            self._parse_spec(campaign_id)
            self._database.write(
                lambda session: planning.plan_piece(session, campaign_id, self._now(session))
            )
            time.sleep(TURN_S)

    def _parse_spec(self, campaign_id: int) -> None:
        with self._database.read() as session:
            spec_of(campaigns.get_campaign_row(session, campaign_id))

    def add_problem(self, problem: Problem) -> bool:
        """Store a problem, so that its hash stands for it; return whether it is new."""
        return self._database.write(lambda session: planning.add_problem(session, problem))

    def register(self, worker: WorkerInfo) -> None:
        """Store what a worker says about itself; one that would compute something else is refused."""
        self._database.write(lambda session: workers.register(session, worker, self._now(session)))

    def claim(
        self, worker: WorkerInfo | str, n_jobs: int, campaign: int | None = None, by: str | None = None
    ) -> list[Claim]:
        """Hand out jobs of one campaign, or of all, for the time of a lease; a worker registers with it.

        `by` names the token that asks; then that token alone extends and ends them.
        """
        lease_s = self.leases.lease_s

        def work(session: Session) -> list[Claim]:
            name = _register(session, worker, self._now(session))
            return claims.claim(session, name, n_jobs, campaign, self._now(session), lease_s, by)

        return self._database.write(work)

    def heartbeat(
        self, worker: WorkerInfo | str, held: Iterable[Ticket], by: str | None = None
    ) -> HeartbeatAnswer:
        """Extend the leases that a worker still holds; tell what to cancel, and what it has lost."""
        lease_s = self.leases.lease_s

        def work(session: Session) -> HeartbeatAnswer:
            name = _register(session, worker, self._now(session))
            return leases.heartbeat(session, name, held, self._now(session), lease_s, by)

        return self._database.write(work)

    def look(self, held: Iterable[Ticket], by: str | None = None) -> HeartbeatAnswer:
        """Tell what to cancel and what is lost, and extend nothing."""
        with self._database.read() as session:
            return leases.look(session, held, by)

    def hand_in(self, request: HandInRequest, by: str | None = None) -> HandInAnswer:
        """Store hops of a chain that goes on; a stale part raises, one that came before changes nothing."""
        return self._database.write(lambda session: completion.hand_in(session, request, self._clock(), by))

    def complete(self, ticket: Ticket, outcome: JobOutcome, by: str | None = None) -> CompleteAnswer:
        """Record an outcome; a stale one raises and changes nothing, a repeated one gets the same answer."""
        return self.complete_many([CompleteRequest(**ticket._asdict(), outcome=outcome)], by)[0]

    def complete_many(
        self, reports: Sequence[CompleteRequest], by: str | None = None
    ) -> list[CompleteAnswer]:
        """Record outcomes in one transaction; a stale one among them raises, and none is stored."""
        return self._database.write(
            lambda session: completion.complete(session, reports, self._now(session), by)
        )

    def now(self) -> float:
        """Return the time by which leases end: that of a database which several coordinators may share."""
        with self._database.read() as session:
            now = self._now(session)
        self._ahead_s = now - self._clock()
        return now

    def reap(self, now: float | None = None) -> int:
        """Expire leases; return how many jobs were requeued."""
        lease_s = self.leases.lease_s
        return self._database.write(
            lambda session: leases.reap(session, self._now(session) if now is None else now, lease_s)
        )

    def renew_leases(self) -> int:
        """Give every job that runs a whole lease; return how many."""
        lease_s = self.leases.lease_s
        return self._database.write(lambda session: leases.renew(session, self._now(session), lease_s))

    def prune(self) -> int:
        """Prune the audit log and the events, some at a time; return how many rows."""
        return self._database.write(lambda session: leases.prune(session, self._now(session)))

    def recover(self, workers: str = "") -> int:
        """Put back the jobs of workers that are gone, by the beginning of their names; return how many."""
        return self._database.write(lambda session: leases.recover(session, workers, self._now(session)))

    def requeue_dead_jobs(self, campaign_id: int) -> int:
        """Requeue the dead jobs of a campaign; return how many."""
        return self._database.write(
            lambda session: control.requeue_dead_jobs(session, campaign_id, self._now(session))
        )

    def control_campaign(self, campaign_id: int, verb: Verb) -> None:
        """Pause, resume or cancel a campaign."""
        self._database.write(
            lambda session: control.control_campaign(session, campaign_id, verb, self._now(session))
        )

    def control_search(self, campaign_id: int, search: str, verb: Verb) -> None:
        """Pause, resume or cancel a search."""
        self._database.write(
            lambda session: control.control_search(session, campaign_id, search, verb, self._now(session))
        )

    def set_campaign(self, campaign_id: int, *, priority: int) -> None:
        """Change the priority of a campaign; lower goes first."""
        self._database.write(lambda session: control.set_campaign(session, campaign_id, priority))

    def set_search(
        self, campaign_id: int, search: str, *, weight: float | None = None, priority: int | None = None
    ) -> None:
        """Set weight or priority of a search."""
        self._database.write(
            lambda session: control.set_search(session, campaign_id, search, weight, priority)
        )

    def cancel_job(self, job_id: int) -> None:
        """Cancel a job that is queued, or have one stopped that runs."""
        self._database.write(lambda session: control.cancel_job(session, job_id, self._now(session)))

    def requeue_job(self, job_id: int) -> None:
        """Requeue a dead or cancelled job."""
        self._database.write(lambda session: control.requeue_job(session, job_id, self._now(session)))

    def import_campaigns(self, read: ReadFile) -> ImportResult:
        """Store the campaigns of a portable file that are not there yet, in one transaction."""
        return self._database.write(
            lambda session: archive_io.import_campaigns(session, read, self._now(session))
        )

    # What reads it.

    def write_portable(self, campaign_id: int, take: Callable[[str, Iterable[Entry]], object]) -> None:
        """Give `take` the hash of a campaign and the entries of its portable file, all of one moment."""
        with self._database.read() as session:
            chain = archive_io.chain_of_campaigns(session, campaign_id)
            take(chain[-1].spec_hash, archive_io.entries(session, chain))

    def read_history(self) -> bool:
        """Read a piece of what cards and histories of campaigns tell of; return whether more may be left."""
        return self._histories.read_on()

    def campaign_cards(self, name_or_id: str | None = None) -> list[CampaignCard]:
        """Return the campaigns with how far they are and what they have found, the newest first, or one."""
        now = self._about_now()
        return self._histories.ask(
            lambda session, known: campaign_history.campaign_cards(session, known, now, name_or_id)
        )

    def campaign_history(self, campaign_id: int) -> HistoryView:
        """Return the history of a campaign."""
        return self._histories.ask(
            lambda session, known: campaign_history.campaign_history(session, known, campaign_id)
        )

    def spec_fields(self, campaign_id: int) -> dict[str, Any]:
        """Return the specification of a campaign as it was submitted."""
        with self._database.read() as session:
            return spec_fields(session, campaign_id)

    def campaign_facts(self, campaign_id: int, most_vectors: int | None = None) -> CampaignFacts:
        """Return the facts behind the metrics of a campaign, without its vectors if there are more."""
        with self._database.read() as session:
            return statistics.campaign_facts(session, campaign_id, most_vectors)

    def n_solves(self, campaign_id: int) -> int:
        """Return how many solves a campaign has made."""
        with self._database.read() as session:
            return statistics.n_solves(session, campaign_id)

    def records(
        self,
        wanted: Filter,
        limit: int,
        begin: Begin = Begin(),  # noqa: B008
        order: Order = Order(),  # noqa: B008
    ) -> RecordPage:
        """Return a page of solutions."""
        with self._database.read() as session:
            return solutions.list_records(session, wanted, order, begin, limit)

    def points(self, wanted: Filter, most: int) -> PointsView:
        """Return the solutions of a filter as points, at most so many of them."""
        with self._database.read() as session:
            return scatter.list_points(session, wanted, most)

    def clusters(self, wanted: Filter, threshold: float, limit: int) -> ClusterPage:
        """Return the best clusters of the solutions of a filter."""
        with self._database.read() as session:
            return scatter.list_clusters(session, wanted, threshold, limit)

    def choices(self, campaign: int | None) -> ChoicesView:
        """Return what a filter of solutions can be set to."""
        with self._database.read() as session:
            return filters.list_choices(session, campaign)

    def record_pages(self, wanted: Filter, size: int = 100) -> Iterator[list[RecordWithVector]]:
        """Yield all solutions of a filter in order of id; each page is one short transaction."""
        after = ""
        while True:
            with self._database.read() as session:
                page = solutions.page_by_id(session, wanted, after, size)
            yield page
            if len(page) < size:
                return
            after = page[-1].id

    def definition_and_vector(self, solution_id: str) -> tuple[dict[str, Any], tuple[float, ...]]:
        """Return the problem of a solution as plain data, and its vector."""
        with self._database.read() as session:
            return solutions.definition_and_vector(session, solution_id)

    def lineage(self, solution_id: str, most: int = 0) -> LineageGraph:
        """Return the seeds behind a solution, and so many of those that it seeded."""
        with self._database.read() as session:
            return lineage.graph(session, solution_id, most)

    def reproduction(self, solution_id: str) -> Reproduction:
        """Return the job that found a solution, and what it gave."""
        with self._database.read() as session:
            return lineage.reproduction(session, solution_id)

    def missed_thrust_analyses(
        self, solution_id: str, campaign_id: int | None = None, limit: int = 1
    ) -> list[solutions.MissedThrustAnalysis]:
        """Return what the newest missed-thrust analyses of a solution found, or that of one campaign."""
        with self._database.read() as session:
            return solutions.find_analyses(session, solution_id, campaign_id, limit)

    def problems(self) -> ProblemPage:
        """Return the problems."""
        with self._database.read() as session:
            return jobs.list_problems(session)

    def problem(self, problem_hash: str) -> ProblemView:
        """Return a problem."""
        with self._database.read() as session:
            return jobs.get_problem(session, problem_hash)

    def family(self, problem_hash: str) -> ProblemFamily:
        """Return what was found for a problem, and its relatives."""
        with self._database.read() as session:
            return family(session, problem_hash)

    def job(self, job_id: int) -> JobView:
        """Return a job."""
        with self._database.read() as session:
            return jobs.get_job(session, job_id)

    def seeds_of_search(self, campaign_id: int, search: str, wanted: SeedChoices) -> SeedPage:
        """Return what would seed a search, and how."""
        with self._database.read() as session:
            return seeds_of_search(session, campaign_id, search, wanted)

    def seeds_of_problem(
        self,
        problem_hash: str,
        outages: Sequence[tuple[int, float]] | None,
        seed_k: int | None,
        wanted: SeedChoices,
    ) -> SeedPage:
        """Return which solutions of the archive would seed a problem, and how."""
        with self._database.read() as session:
            return seeds_of_problem(session, problem_hash, outages, seed_k, wanted)

    def events(self, after: int, campaign: int | None = None, limit: int = 200) -> list[EventView]:
        """Return the events that follow an id."""
        with self._database.read() as session:
            return events.events_after(session, after, campaign, limit)

    def last_event_id(self, campaign: int | None) -> int:
        """Return the id of the latest event of a campaign, or of all, or 0."""
        with self._database.read() as session:
            return events.last_event_id(session, campaign)

    def check(self) -> None:
        """Raise unless the archive takes a write and is of this version."""
        self._database.write(require_writable)


def _register(session: Session, worker: WorkerInfo | str, now: float) -> str:
    """Store what a worker says about itself, where it does, in the transaction of what it asks for."""
    if isinstance(worker, str):
        return worker
    workers.register(session, worker, now)
    return worker.name
