"""Database access: the location of an archive, its one writer and its read-only readers.

A write is one transaction of its own.  Several in one commit would save little: the commit takes 0.5 ms of
the 12 ms that an outcome takes.  How long writes take is counted for /metrics.
"""

import os
import threading
import time
from bisect import bisect_left
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import TypeVar

from sqlalchemy import URL, Engine, make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, SQLAlchemyError
from sqlalchemy.orm import Session

from core.plain_data import read_text
from service.db import postgres, sqlite
from service.db.dialect import create_tables, is_empty, read_version
from service.db.errors import (
    DatabaseError,
    UnavailableError,
    no_archive,
    no_room,
    read_fault,
    unusable,
    write_fault,
)
from service.db.tables import SCHEMA_VERSION
from workers.retry import Downtime

T = TypeVar("T")

FILE_NAME = "coastarc.db"
#: The URL itself, or the file that holds it, as secrets are mounted in containers.
URL_VARIABLE = "COASTARC_DATABASE_URL"
DRIVER = "postgresql+psycopg"

#: An SQLite file, or a PostgreSQL database.
Place = Path | URL


def make_folder(folder: Path) -> None:
    """Make a data folder where there is none."""
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        raise unusable(folder, error.strerror) from error


def place_of(folder: Path) -> Place:
    """Return where the archive of a data folder is: in it, unless the environment names a database."""
    url = os.environ.get(URL_VARIABLE)
    if path := os.environ.get(f"{URL_VARIABLE}_FILE"):
        try:
            url = read_text(Path(path)).strip()
        except (OSError, ValueError) as error:
            raise DatabaseError(f"{URL_VARIABLE}_FILE: expected a file to read, got {error}") from error
    return folder / FILE_NAME if not url else database_url(url)


def database_url(text: str) -> URL:
    """Return the URL of a PostgreSQL database; the text may hold a password and is never repeated."""
    expected = f"{URL_VARIABLE}: expected {DRIVER}://USER@HOST/DATABASE"
    try:
        url = make_url(text)
    except (ArgumentError, ValueError):
        raise DatabaseError(f"{expected}, got no URL") from None
    if url.drivername in ("postgresql", "postgres"):
        url = url.set(drivername=DRIVER)
    if url.drivername != DRIVER:
        raise DatabaseError(f"{expected}, got one of {url.drivername}; SQLite archives are named by --data")
    if not url.database:
        raise DatabaseError(f"{expected}, got none of a database")
    return url


def shown(place: Place) -> str:
    """Return a place as users may read it, without a password."""
    return str(place) if isinstance(place, Path) else place.render_as_string(hide_password=True)


#: Upper ends of the classes in which writes are counted [s].
CLASSES_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0)


class WriteTimes:
    """A histogram of the writes of one process; a write's time begins when it asks for its turn."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts = [0] * (len(CLASSES_S) + 1)
        self._seconds = 0.0
        self._n_faults = 0

    def add(self, seconds: float) -> None:
        """Count a write that was stored."""
        with self._lock:
            self._counts[bisect_left(CLASSES_S, seconds)] += 1
            self._seconds += seconds

    def add_fault(self) -> None:
        """Count a write that the place did not take."""
        with self._lock:
            self._n_faults += 1

    def read(self) -> tuple[list[int], float, int]:
        """Return the writes per class, those above the last one at the end; their seconds; the faults."""
        with self._lock:
            return list(self._counts), self._seconds, self._n_faults


class Moment(Enum):
    """When a test may let a write fail."""

    BEFORE_COMMIT = "Nothing is stored yet."
    AFTER_COMMIT = "All is stored, and the caller does not know it."


class Database:
    """The connections of one process to one archive."""

    def __init__(self, place: Place, *, read_only: bool = False) -> None:
        self.place = place
        self.name = shown(place)
        #: Called in every write; what it raises ends the write.
        self.hook: Callable[[Moment], None] = lambda moment: None
        self.write_times = WriteTimes()
        self.downtime = Downtime("archive")
        self._lock = threading.Lock()
        self._writer: Engine | None = None
        if isinstance(place, Path):
            _require_usable(place, read_only)
        try:
            self._reader = _reader(place)
            self._writer = None if read_only else _writer(place)
            self._open()
        except DBAPIError as error:
            self.close()
            raise self._unusable(error) from error
        except DatabaseError:
            self.close()
            raise

    def write(self, work: Callable[[Session], T]) -> T:
        """Run `work` in one write transaction; it is stored whole or, if it raises, not at all."""
        if self._writer is None:
            raise DatabaseError(
                f"archive: expected to be opened for writing, got read-only access to {self.name}"
            )
        begin = time.perf_counter()
        with self._lock:
            try:
                with Session(self._writer, expire_on_commit=False) as session, session.begin():
                    answer = work(session)
                    session.flush()
                    self.hook(Moment.BEFORE_COMMIT)
            except SQLAlchemyError as error:
                if fault := write_fault(self.name, error):
                    self.write_times.add_fault()
                    raise fault from error
                raise
        self.downtime.end()
        self.write_times.add(time.perf_counter() - begin)
        self.hook(Moment.AFTER_COMMIT)
        return answer

    @contextmanager
    def read(self) -> Iterator[Session]:
        """Give a session that sees one state of the database and cannot write."""
        try:
            with Session(self._reader, expire_on_commit=False) as session:
                yield session
        except SQLAlchemyError as error:
            if fault := read_fault(self.name, error):
                raise fault from error
            raise

    def close(self) -> None:
        """Close all connections; the last one of an SQLite file empties its journal if it can write."""
        if hasattr(self, "_reader"):
            self._reader.dispose()
        if self._writer is not None:
            self._writer.dispose()

    def _open(self) -> None:
        if self._writer is not None:
            with self._writer.begin() as connection:
                # What holds tables of another version is left as it is, for the version check to refuse.
                if is_empty(connection):
                    create_tables(connection, SCHEMA_VERSION)
        with self._reader.connect() as connection:
            version = read_version(connection)
        if version != SCHEMA_VERSION:
            raise DatabaseError(
                f"archive {self.name}: expected schema version {SCHEMA_VERSION}, {_got(version)}"
            )

    def _unusable(self, error: DBAPIError) -> DatabaseError:
        if isinstance(self.place, Path):
            return no_room(self.place, error.orig) or unusable(self.place, error.orig)
        reason = str(error.orig).strip().splitlines()[-1]
        kind = UnavailableError if postgres.may_pass(reason) else DatabaseError
        return kind(
            f"archive {self.name}: expected a PostgreSQL database, got {reason}; "
            f"look at COASTARC_DATABASE_URL and at the server"
        )


def _got(version: int | None) -> str:
    if version is None:
        return "got a database without one; name another one"
    if version < SCHEMA_VERSION:
        return f"got {version}; bring it to this version with `coastarc db upgrade`"
    return f"got {version}; install a newer coastarc, or name another folder with --data"


def _require_usable(path: Path, read_only: bool) -> None:
    """Refuse a file that is not there or not whole, and a place where none would stay so."""
    if read_only and not sqlite.is_file(path):
        raise no_archive(path)
    sqlite.require_local(path)
    if read_only or not sqlite.was_left_open(path):
        return
    if faults := sqlite.integrity_faults(path):
        raise DatabaseError(
            f"archive {path}: expected a whole file after an unclean stop, got {faults[0]}; "
            f"restore a backup with `coastarc db restore`"
        )


def _writer(place: Place) -> Engine:
    return sqlite.writer_engine(place) if isinstance(place, Path) else postgres.writer_engine(place)


def _reader(place: Place) -> Engine:
    return sqlite.reader_engine(place) if isinstance(place, Path) else postgres.reader_engine(place)
