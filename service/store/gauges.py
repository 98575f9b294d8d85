"""What operators watch: how much waits, how old it is, how it ends, and how large the archive grows.

All of it is read from the tables when it is asked for, so that a restart loses nothing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import func, select, text, true
from sqlalchemy.orm import Session

from service.db.dialect import VERSION_TABLE, counted, read_version
from service.db.engine import Database, DatabaseError
from service.db.tables import SCHEMA_VERSION, CampaignRow, JobRow, WorkerRow
from service.store.tallies import job_states, summed, totals


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

    @property
    def write_times(self) -> tuple[list[int], float, int]:
        """The histogram of writes; see `service.db.engine`."""
        return self._database.write_times.read()

    def read(self) -> Reading:
        """Return all gauges."""
        with self._database.read() as session:
            now = self._clock()
            n_workers, n_slots = _workers(session, now, self._lease_s)
            jobs = summed(job_states(session, true()).values())
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
