"""Counters, the facts behind a campaign's statistics, and what /metrics reads.

Counters are rows per search that grow in the transaction that adds what they count:

| of       | by                                                            |
|----------|---------------------------------------------------------------|
| attempt  | ending                                                        |
| job      | `done` alone: the others are few, or what is left             |
| solve    | ending, with processor time                                   |
| status   | status of a solve                                             |
| level    | `paper`, `strict`: solves that reach it                       |
| solution | where nobody had found it before: see `scope_of`              |
| strict   | the same, of solutions that are strict                        |

Operators' metrics are read from the tables when they are asked for, so that a restart loses nothing.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from sqlalchemy import ColumnElement, bindparam, case, func, literal_column, select, text, true
from sqlalchemy.orm import Session

from core.analysis.campaign_facts import CampaignFacts, SolveFacts
from service.db.dialect import INSERTS, VERSION_TABLE, counted, plain, read_version
from service.db.engine import Database
from service.db.errors import DatabaseError
from service.db.tables import (
    SCHEMA_VERSION,
    CampaignRow,
    JobRow,
    SearchRow,
    SolutionRow,
    SolveRow,
    TallyRow,
    WorkerRow,
    shared_columns,
)
from service.db.transitions import ENDED
from service.spec.search_spec import SearchSpec
from service.store.cache import spec_of
from service.store.errors import UnknownRowError

#: Of one search by (noun, name).
Key = tuple[str, str]
#: A solution that is new to the archive is new to its campaign and its search too, and so on.
SCOPES = ("archive", "campaign", "search")

_TALLY = plain(TallyRow)
_SOLVE = plain(SolveRow).c
_SEARCH = plain(SearchRow).c
_FINDERS = (
    select(_SOLVE.search_id, _SEARCH.campaign_id)
    .join(plain(SearchRow), _SEARCH.id == _SOLVE.search_id)
    .where(_SOLVE.solution_id == bindparam("solution_id"))
    .distinct()
)


class Counts:
    """What is to be added to tallies."""

    def __init__(self) -> None:
        self._numbers: Counter[tuple[int, str, str]] = Counter()
        self._seconds: defaultdict[tuple[int, str, str], float] = defaultdict(float)

    def add(self, search_id: int, noun: str, name: str, cpu_seconds: float = 0.0, *, number: int = 1) -> None:
        """Count one, or what is said."""
        self._numbers[search_id, noun, name] += number
        self._seconds[search_id, noun, name] += cpu_seconds

    def store(self, session: Session) -> None:
        """Add all of it to the tallies, in an order that is the same for everybody."""
        if not self._numbers:
            return
        rows = [
            dict(zip(("search_id", "noun", "name"), key, strict=True))
            | {"number": number, "cpu_seconds": self._seconds[key]}
            for key, number in sorted(self._numbers.items())
        ]
        connection = session.connection()
        connection.execute(_addition(connection.dialect.name), rows)


@cache
def _addition(dialect: str) -> Any:
    statement = INSERTS[dialect](_TALLY)
    columns, more = _TALLY.c, statement.excluded
    return statement.on_conflict_do_update(
        index_elements=list(_TALLY.primary_key),
        set_={
            "number": columns.number + more.number,
            "cpu_seconds": columns.cpu_seconds + more.cpu_seconds,
        },
    )


def scope_of(session: Session, solution_id: str, search_id: int, campaign_id: int) -> str | None:
    """Return the widest of the scopes in which nobody has found a solution yet, or None if all know it."""
    finders = session.connection().execute(_FINDERS, {"solution_id": solution_id}).all()
    if not finders:
        return "archive"
    if all(campaign != campaign_id for _, campaign in finders):
        return "campaign"
    return None if search_id in {search for search, _ in finders} else "search"


def tallies(session: Session, wanted: ColumnElement[bool]) -> dict[int, dict[str, dict[str, int]]]:
    """Return the numbers of some searches: by search, noun and name."""
    query = (
        select(TallyRow.search_id, TallyRow.noun, TallyRow.name, TallyRow.number)
        .join(SearchRow, SearchRow.id == TallyRow.search_id)
        .where(wanted)
        .order_by(TallyRow.search_id, TallyRow.noun, TallyRow.name)
    )
    found: dict[int, dict[str, dict[str, int]]] = defaultdict(lambda: defaultdict(dict))
    for search_id, noun, name, number in session.execute(query):
        found[search_id][noun][name] = number
    return found


def totals(session: Session, noun: str) -> dict[str, tuple[int, float]]:
    """Return the numbers and processor times [s] of the whole archive by name."""
    query = (
        select(TallyRow.name, func.sum(TallyRow.number), func.sum(TallyRow.cpu_seconds))
        .where(TallyRow.noun == noun)
        .group_by(TallyRow.name)
    )
    return {name: (int(number), seconds) for name, number, seconds in session.execute(query)}


def n_solutions(counted: dict[str, int], scope: str) -> int:
    """Return how many different solutions were found within a scope, from what its searches tell."""
    return sum(counted.get(name, 0) for name in SCOPES[: SCOPES.index(scope) + 1])


#: The state of most jobs that have not run: counted as what is left, since nothing bounds their number.
_LEFT = case((SearchRow.state.in_(ENDED), "cancelled"), else_="queued")
_FEW = case((SearchRow.state.in_(ENDED), literal_column("'queued'")), else_=literal_column("'cancelled'"))


def job_states(session: Session, wanted: ColumnElement[bool]) -> dict[int, dict[str, int]]:
    """Return how many jobs of some searches are in each state; none that is 0."""
    mine = (JobRow.search_id == SearchRow.id) & JobRow.state.in_(
        [literal_column("'running'"), literal_column("'dead'"), _FEW]
    )
    few = (
        select(SearchRow.id, JobRow.state, func.count())
        .select_from(SearchRow)
        .join(JobRow, mine)
        .where(wanted)
        .group_by(SearchRow.id, JobRow.state)
    )
    is_done = (TallyRow.search_id == SearchRow.id) & (TallyRow.noun == "job") & (TallyRow.name == "done")
    every = select(SearchRow.id, SearchRow.n_planned, _LEFT, TallyRow.number)
    every = every.select_from(SearchRow).outerjoin(TallyRow, is_done)
    found: dict[int, dict[str, int]] = defaultdict(dict)
    for search_id, state, number in session.execute(few):
        found[search_id][state] = number
    for search_id, n_planned, left, n_done in session.execute(every.where(wanted)):
        counts = found[search_id]
        counts["done"] = n_done or 0
        counts[left] = n_planned - sum(counts.values())
        found[search_id] = {state: number for state, number in counts.items() if number}
    return dict(found)


def sum_counts(counts: Iterable[dict[str, int]]) -> dict[str, int]:
    """Return the sum of several counts by name."""
    total: Counter[str] = Counter()
    for one in counts:
        total.update(one)
    return dict(total)


#: Columns that a fact takes over as they are.
FROM_JOB = (JobRow.mapping, JobRow.chain, JobRow.seed_id)
FROM_SOLVE = tuple(getattr(SolveRow, name) for name in shared_columns(SolveRow, SolveFacts))
FROM_SOLUTION = tuple(
    getattr(SolutionRow, name) for name in shared_columns(SolutionRow, SolveFacts, but=("paper", "strict"))
)


def campaign_facts(session: Session, campaign_id: int, most_vectors: int | None = None) -> CampaignFacts:
    """Return what a campaign has found so far, whether it has ended or not.

    The vectors of its solutions are left out where they are more than `most_vectors`.
    """
    campaign = session.get(CampaignRow, campaign_id)
    if campaign is None:
        raise UnknownRowError("campaign", campaign_id)
    return CampaignFacts(
        id=campaign.id,
        name=campaign.name,
        state=campaign.state,
        rng_seed=campaign.rng_seed,
        problem=spec_of(campaign).problem,
        solves=tuple(_solves(session, campaign)),
        vectors=_vectors(session, campaign, most_vectors),
    )


def _solves(session: Session, campaign: CampaignRow) -> Iterator[SolveFacts]:
    spec = spec_of(campaign)
    searches = [_of_search(search) for search in spec.search]
    cases = [search.outage_sets for search in spec.search]
    query = (
        select(SearchRow.position, JobRow.case_index, *FROM_JOB, *FROM_SOLVE, *FROM_SOLUTION)
        .join(SearchRow, SearchRow.id == SolveRow.search_id)
        .join(JobRow, JobRow.id == SolveRow.job_id)
        .outerjoin(SolutionRow, SolutionRow.id == SolveRow.solution_id)
        .where(SearchRow.campaign_id == campaign.id)
        .order_by(SearchRow.position, JobRow.case_index, JobRow.chain, SolveRow.hop)
    )
    names = [column.key for column in (*FROM_JOB, *FROM_SOLVE, *FROM_SOLUTION)]
    # Past the session, whose own loading takes longer than all the rest.
    for position, place, *values in session.connection().execute(query):
        facts = dict(zip(names, values, strict=True))
        yield SolveFacts(**searches[position], outages=cases[position][place], **facts)


def _of_search(search: SearchSpec) -> dict[str, Any]:
    return {
        "search": search.id,
        "seeds_from": search.seeds.full_name if search.seeds else None,
        "strategy": search.strategy,
        "k": search.k,
        "seed_k": search.seed_k,
        "seed_level": search.seeds.tolerance if search.seeds else None,
        "cap_seconds": search.cpu_seconds * (1 + search.k),
    }


def _vectors(session: Session, campaign: CampaignRow, most: int | None) -> dict[str, Any]:
    of_campaign = (
        select(SolveRow.solution_id)
        .join(SearchRow, SearchRow.id == SolveRow.search_id)
        .where(SearchRow.campaign_id == campaign.id, SolveRow.solution_id.is_not(None))
    )
    if most is not None:
        some = of_campaign.distinct().limit(most + 1).subquery()
        if (session.scalar(select(func.count()).select_from(some)) or 0) > most:
            return {}
    query = select(SolutionRow.id, SolutionRow.x).where(SolutionRow.id.in_(of_campaign))
    return {solution_id: x for solution_id, x in session.execute(query)}


def n_solves(session: Session, campaign_id: int) -> int:
    """Return how many solves a campaign has made, as its searches count them."""
    if session.get(CampaignRow, campaign_id) is None:
        raise UnknownRowError("campaign", campaign_id)
    return (
        session.scalar(select(func.sum(SearchRow.n_solves)).where(SearchRow.campaign_id == campaign_id)) or 0
    )


@dataclass(frozen=True, slots=True)
class Reading:
    """All gauges at one moment."""

    jobs: dict[str, int]
    campaigns: dict[str, int]
    #: By ending; `open` are those that run.
    attempts: dict[str, int]
    solves: dict[str, int]
    solve_seconds: dict[str, float]
    n_solutions: int
    n_workers: int
    n_slots: int
    #: Since the last heartbeat for the job that has had none for longest [s]; 0 where none runs.
    oldest_lease_s: float
    archive_bytes: int


class OperatorMetrics:
    """The gauges of one archive."""

    def __init__(self, database: Database, clock: Callable[[], float], lease_s: float) -> None:
        self._database = database
        self._clock = clock
        self._lease_s = lease_s

    @property
    def write_times(self) -> tuple[list[int], float, int]:
        """The histogram of writes; see `service.db.engine`."""
        return self._database.write_times.read()

    def read(self) -> Reading:
        """Return all gauges."""
        with self._database.read() as session:
            now = self._clock()
            n_workers, n_slots = _workers(session, now, self._lease_s)
            jobs = sum_counts(job_states(session, true()).values())
            attempts, solves = totals(session, "attempt"), totals(session, "solve")
            return Reading(
                jobs=jobs,
                campaigns=counted(session, _by(CampaignRow.state)),
                attempts={name: number for name, (number, _) in attempts.items()}
                | {"open": jobs.get("running", 0)},
                solves={name: number for name, (number, _) in solves.items()},
                solve_seconds={name: seconds for name, (_, seconds) in solves.items()},
                n_solutions=totals(session, "solution").get("archive", (0, 0.0))[0],
                n_workers=n_workers,
                n_slots=n_slots,
                oldest_lease_s=_oldest_lease_s(session, now, self._lease_s),
                archive_bytes=_archive_bytes(session, self._database),
            )

    def n_workers(self) -> int:
        """Return how many dispatchers were seen within the time of a lease."""
        with self._database.read() as session:
            return _workers(session, self._clock(), self._lease_s)[0]


def _by(column: Any) -> Any:
    return select(column, func.count()).group_by(column)


def _workers(session: Session, now: float, lease_s: float) -> tuple[int, int]:
    """Return how many workers are there, and their slots; none can have been seen in the future."""
    query = select(func.count(), func.coalesce(func.sum(WorkerRow.slots), 0))
    is_here = WorkerRow.seen_at.between(now - lease_s, now + lease_s)
    n_workers, n_slots = session.execute(query.where(is_here)).one()
    return n_workers, int(n_slots)


def _oldest_lease_s(session: Session, now: float, lease_s: float) -> float:
    first = session.scalar(select(func.min(JobRow.lease_until)).where(JobRow.state == "running"))
    return 0.0 if first is None else max(0.0, now - (first - lease_s))


def _archive_bytes(session: Session, database: Database) -> int:
    if isinstance(database.place, Path):
        files = (database.place, database.place.with_name(database.place.name + "-wal"))
        return sum(file.stat().st_size for file in files if file.exists())
    return session.scalar(text("SELECT pg_database_size(current_database())")) or 0


def require_writable(session: Session) -> None:
    """Raise unless a write goes through and the schema is this version's."""
    version = read_version(session.connection())
    if version != SCHEMA_VERSION:
        raise DatabaseError(f"archive: expected schema version {SCHEMA_VERSION}, got {version}")
    # Changes nothing, but has to be written: a full disk is noticed.
    session.execute(text(f"UPDATE {VERSION_TABLE} SET version_num = version_num"))
