"""What operators watch: how much waits, how old it is, how it ends, and how large the archive grows.

All of it is read from the tables when it is asked for, so that a restart loses nothing.  Sums over tables
that only grow are kept and brought up to date; what must be counted anew is kept for a while.
"""

import threading
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import func, select, text
from sqlalchemy.orm import Session

from service.db.counts import counted
from service.db.dialect import VERSION_TABLE, read_version
from service.db.engine import Database, DatabaseError
from service.db.tables import (
    SCHEMA_VERSION,
    AttemptRow,
    CampaignRow,
    JobRow,
    SolutionRow,
    SolveRow,
    WorkerRow,
)

#: How long counts of whole tables are kept [s]: with a million rows each takes a good part of a second.
KEPT_S = 10.0


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


class Gauges:
    """The gauges of one archive."""

    def __init__(self, database: Database, clock: Callable[[], float], lease_s: float) -> None:
        self._database = database
        self._clock = clock
        self._lease_s = lease_s
        self._lock = threading.Lock()
        self._last_solve = 0
        self._n_solves: Counter[str] = Counter()
        self._solve_seconds: defaultdict[str, float] = defaultdict(float)
        self._kept: dict[str, tuple[float, dict[str, int]]] = {}

    @property
    def write_times(self) -> tuple[list[int], float, int]:
        """The histogram of writes; see `service.db.write_times`."""
        return self._database.write_times.read()

    def read(self) -> Reading:
        """Return all gauges."""
        with self._lock, self._database.read() as session:
            now = self._clock()
            self._add_solves(session)
            n_workers, n_slots = _workers(session, now - self._lease_s)
            counts = {
                name: self._counted(name, now, session, query)
                for name, query in (("jobs", _jobs), ("attempts", _attempts), ("solutions", _solutions))
            }
            return Reading(
                jobs=counts["jobs"],
                campaigns=counted(session, _by(CampaignRow.state)),
                attempts=counts["attempts"],
                solves=dict(self._n_solves),
                solve_seconds=dict(self._solve_seconds),
                n_solutions=counts["solutions"][""],
                n_workers=n_workers,
                n_slots=n_slots,
                oldest_lease_s=_oldest_lease_s(session, now, self._lease_s),
                archive_bytes=_archive_bytes(session, self._database),
            )

    def n_workers(self) -> int:
        """Return how many dispatchers were seen within the time of a lease."""
        with self._database.read() as session:
            return _workers(session, self._clock() - self._lease_s)[0]

    def _add_solves(self, session: Session) -> None:
        # A solve is stored once and never changed, and the one writer stores them in order of id.
        last = session.scalar(select(func.max(SolveRow.id))) or 0
        query = (
            select(SolveRow.ending, func.count(), func.sum(SolveRow.cpu_seconds))
            .where(SolveRow.id > self._last_solve, SolveRow.id <= last)
            .group_by(SolveRow.ending)
        )
        for ending, number, seconds in session.execute(query):
            self._n_solves[ending] += number
            self._solve_seconds[ending] += seconds
        self._last_solve = last

    def _counted(
        self, name: str, now: float, session: Session, query: Callable[[Session], dict[str, int]]
    ) -> dict[str, int]:
        until, counts = self._kept.get(name, (0.0, {}))
        if now >= until:
            counts = query(session)
            self._kept[name] = (now + KEPT_S, counts)
        return counts


def _by(column: Any) -> Any:
    return select(column, func.count()).group_by(column)


def _jobs(session: Session) -> dict[str, int]:
    return counted(session, _by(JobRow.state))


def _attempts(session: Session) -> dict[str, int]:
    return counted(session, _by(func.coalesce(AttemptRow.ending, "open")))


def _solutions(session: Session) -> dict[str, int]:
    return {"": session.scalar(select(func.count()).select_from(SolutionRow)) or 0}


def _workers(session: Session, since: float) -> tuple[int, int]:
    query = select(func.count(), func.coalesce(func.sum(WorkerRow.slots), 0))
    n_workers, n_slots = session.execute(query.where(WorkerRow.seen_at > since)).one()
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
