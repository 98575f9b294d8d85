"""Online backup of a whole archive to one file, and restore into an empty place.

The file is an SQLite archive whichever database it comes from, so it is also the way from one to the other.
"""

import os
import sqlite3
from collections.abc import Callable
from pathlib import Path

from sqlalchemy import Connection, insert, select

from service.db import postgres, sqlite
from service.db.dialect import create_tables, go_on_counting, is_empty
from service.db.engine import Place, shown
from service.db.errors import DatabaseError, no_archive
from service.db.tables import SCHEMA_VERSION, Base
from service.db.upgrade import version_of

#: Rows that are in memory at once.
CHUNK = 500


def backup(place: Place, file: Path) -> None:
    """Write one state of an archive to a file that does not exist yet."""
    if file.exists():
        raise DatabaseError(f"backup {file}: expected a new file, got one that exists; name another")
    if isinstance(place, Path):
        if not sqlite.is_file(place):
            raise no_archive(place)
        _appear(file, lambda target: _vacuum(place, target))
    else:
        _require_version(place)
        _appear(file, lambda target: _from_postgres(place, target))


def restore(file: Path, place: Place) -> int:
    """Fill an empty place from a backup; return the schema version of what is there then."""
    if not sqlite.is_file(file):
        raise DatabaseError(f"backup: expected a file, got {file}, which is none")
    if faults := sqlite.integrity_faults(file):
        raise DatabaseError(f"backup {file}: expected a whole archive, got {faults[0]}")
    version = version_of(file)
    if version is None or version > SCHEMA_VERSION:
        raise DatabaseError(
            f"backup {file}: expected schema version {SCHEMA_VERSION} or less, got {version or 'none'}"
        )
    if isinstance(place, Path):
        for there in (place, place.with_name(place.name + "-wal")):
            if there.exists():
                raise DatabaseError(
                    f"archive {there}: expected an empty place to restore into, got a file; "
                    f"move it away, or name another folder with --data"
                )
        _appear(place, lambda target: _vacuum(file, target))
    else:
        _require_version(file)
        _to_postgres(file, place)
    return version


def _appear(file: Path, make: Callable[[Path], None]) -> None:
    """Make a file under another name first, so that its own name never stands for half of it."""
    partial = file.with_name(file.name + ".partial")
    try:
        partial.unlink(missing_ok=True)
        sqlite.make_private(partial)
        make(partial)
        with open(partial, "rb") as made:
            os.fsync(made.fileno())
        partial.rename(file)
    except (OSError, sqlite3.Error) as error:
        raise DatabaseError(f"file {file}: expected a place to write it, got {error}") from error
    finally:
        for left in (
            partial,
            *(partial.with_name(partial.name + end) for end in ("-wal", "-shm", "-journal")),
        ):
            left.unlink(missing_ok=True)


def _vacuum(source: Path, target: Path) -> None:
    # One read transaction, in which writers are not held up; the copy has no holes and no journal.
    connection = sqlite3.connect(sqlite.read_only_address(source), uri=True, isolation_level=None)
    try:
        connection.execute(f"PRAGMA busy_timeout = {sqlite.BUSY_TIMEOUT_MS}")
        connection.execute("VACUUM INTO ?", (str(target),))
    finally:
        connection.close()


def _from_postgres(place: Place, target: Path) -> None:
    assert not isinstance(place, Path)
    reader, writer = postgres.reader_engine(place), sqlite.writer_engine(target, checks_references=False)
    try:
        with reader.connect() as source, writer.begin() as connection:
            create_tables(connection, SCHEMA_VERSION)
            _copy(source, connection)
            if faults := sqlite.reference_faults(connection):
                raise DatabaseError(f"archive {shown(place)}: expected whole rows, got {faults[0]}")
    finally:
        reader.dispose()
        # The last connection that closes empties the journal into the file.
        writer.dispose()


def _to_postgres(file: Path, place: Place) -> None:
    assert not isinstance(place, Path)
    reader, writer = sqlite.reader_engine(file), postgres.writer_engine(place)
    try:
        with reader.connect() as source, writer.begin() as connection:
            if not is_empty(connection):
                raise DatabaseError(
                    f"archive {shown(place)}: expected an empty database to restore into, got tables"
                )
            create_tables(connection, SCHEMA_VERSION)
            _copy(source, connection)
            go_on_counting(connection)
    finally:
        reader.dispose()
        writer.dispose()


def _copy(source: Connection, target: Connection) -> None:
    for table in Base.metadata.sorted_tables:
        # In the order of their keys a search follows the search that feeds it.
        query = select(table).order_by(*table.primary_key.columns).execution_options(yield_per=CHUNK)
        for rows in source.execute(query).mappings().partitions():
            target.execute(insert(table), [dict(row) for row in rows])


def _require_version(place: Place) -> None:
    version = version_of(place)
    if version != SCHEMA_VERSION:
        raise DatabaseError(
            f"archive {shown(place)}: expected schema version {SCHEMA_VERSION}, got {version or 'none'}; "
            f"bring it to this version with `coastarc db upgrade`"
        )
