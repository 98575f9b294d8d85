"""One writer and read-only readers on one SQLite file.

Reading first and writing later inside a deferred transaction fails at once when another writer came
between, whatever the time-out; so every write begins IMMEDIATE, and there is one writer.

    DatabaseError(RuntimeError)   a file that is no archive of this version, or none at all
"""

import sqlite3
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote

from sqlalchemy import Engine, create_engine, event
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session
from sqlalchemy.pool import QueuePool

from service.db.tables import SCHEMA_VERSION, Base

T = TypeVar("T")


class DatabaseError(RuntimeError):
    """A file that is no archive of this version, or none at all."""


def unusable(path: Path, reason: object) -> DatabaseError:
    """Return the error of a place where no archive can be."""
    return DatabaseError(
        f"archive {path}: expected an SQLite archive, got {reason}; name another folder with --data"
    )


class Database:
    """The connections of one process to one file."""

    def __init__(self, path: Path, *, read_only: bool = False) -> None:
        self.path = path
        self._lock = threading.Lock()
        if read_only and not _is_file(path):
            raise DatabaseError(f"archive: expected a file, got {path}, which is none; run a campaign first")
        self._writer = None if read_only else _writer_engine(path)
        self._reader = _reader_engine(path)
        try:
            if self._writer is not None:
                _create_tables(self._writer)
            self._require_version()
        except DBAPIError as error:
            self.close()
            raise unusable(path, error.orig) from error
        except DatabaseError:
            self.close()
            raise

    def write(self, work: Callable[[Session], T]) -> T:
        """Run `work` in one write transaction; it is stored whole or, if it raises, not at all."""
        if self._writer is None:
            raise DatabaseError(
                f"archive: expected to be opened for writing, got read-only access to {self.path}"
            )
        with self._lock, Session(self._writer, expire_on_commit=False) as session, session.begin():
            return work(session)

    @contextmanager
    def read(self) -> Iterator[Session]:
        """Give a session that sees one state of the database and cannot write."""
        with Session(self._reader, expire_on_commit=False) as session:
            yield session

    def close(self) -> None:
        """Close all connections."""
        self._reader.dispose()
        if self._writer is not None:
            self._writer.dispose()

    def _require_version(self) -> None:
        with self._reader.connect() as connection:
            version = connection.exec_driver_sql("PRAGMA user_version").scalar()
        if version != SCHEMA_VERSION:
            raise DatabaseError(
                f"archive {self.path}: expected schema version {SCHEMA_VERSION}, got {version}; "
                f"name another folder with --data"
            )


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError as error:
        raise unusable(path, error.strerror) from error


def _writer_engine(path: Path) -> Engine:
    engine = _engine(str(path), uri=False)
    event.listen(engine, "connect", _on_writer_connect)
    event.listen(engine, "begin", lambda connection: connection.exec_driver_sql("BEGIN IMMEDIATE"))
    return engine


def _reader_engine(path: Path) -> Engine:
    engine = _engine(f"file:{quote(str(path.absolute()))}?mode=ro", uri=True)
    event.listen(engine, "connect", _on_reader_connect)
    event.listen(engine, "begin", lambda connection: connection.exec_driver_sql("BEGIN"))
    return engine


def _engine(place: str, *, uri: bool) -> Engine:
    # Not by URL: a folder may have any character in its name.
    return create_engine(
        "sqlite://",
        creator=lambda: sqlite3.connect(place, uri=uri, check_same_thread=False),
        poolclass=QueuePool,
    )


def _on_writer_connect(connection: sqlite3.Connection, _: Any) -> None:
    # We begin transactions ourselves; the driver's own rule would begin them too late.
    connection.isolation_level = None
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = NORMAL")
    connection.execute("PRAGMA foreign_keys = ON")
    connection.execute("PRAGMA busy_timeout = 5000")
    connection.execute("PRAGMA trusted_schema = OFF")


def _on_reader_connect(connection: sqlite3.Connection, _: Any) -> None:
    connection.isolation_level = None
    connection.execute("PRAGMA query_only = ON")
    connection.execute("PRAGMA busy_timeout = 5000")
    connection.execute("PRAGMA trusted_schema = OFF")


def _create_tables(engine: Engine) -> None:
    with engine.begin() as connection:
        # A file with tables of another version is left as it is, for the version check to refuse.
        if connection.exec_driver_sql("SELECT count(*) FROM sqlite_schema").scalar() == 0:
            Base.metadata.create_all(connection)
            connection.exec_driver_sql(f"PRAGMA user_version = {SCHEMA_VERSION}")
