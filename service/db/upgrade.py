"""Bringing an archive of an older version to this one, all or nothing."""

from importlib.resources import files
from pathlib import Path
from typing import Any

from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from sqlalchemy import Connection, Engine, inspect
from sqlalchemy.exc import DBAPIError

from service.db import postgres, sqlite
from service.db.dialect import VERSION_TABLE, is_empty, mark_version, read_version, revision
from service.db.engine import Place, shown
from service.db.errors import DatabaseError, write_fault
from service.db.tables import SCHEMA_VERSION, Base


def upgrade(place: Place, version: int = SCHEMA_VERSION) -> int:
    """Bring an archive to a version and return the one that it had; a place without one gets its tables."""
    engine = _engine(place)
    try:
        with engine.begin() as connection:
            return _upgrade(connection, version, shown(place))
    except DBAPIError as error:
        fault = write_fault(shown(place), error)
        if fault is None:
            raise
        raise fault from error
    finally:
        engine.dispose()


def version_of(place: Place) -> int | None:
    """Return the schema version of an archive, whichever it is."""
    engine = sqlite.reader_engine(place) if isinstance(place, Path) else postgres.reader_engine(place)
    try:
        with engine.connect() as connection:
            return read_version(connection)
    except DBAPIError as error:
        raise DatabaseError(f"archive {shown(place)}: expected an archive, got {error.orig}") from error
    finally:
        engine.dispose()


def differences(connection: Connection) -> list[str]:
    """Return how the tables differ from those of this version."""
    context = MigrationContext.configure(connection, opts={"compare_type": True})
    return [_describe(entry) for entry in compare_metadata(context, Base.metadata)]


def _engine(place: Place) -> Engine:
    if isinstance(place, Path):
        sqlite.require_local(place)
        # A table that is built anew is away for a moment, with what refers to it still there.
        return sqlite.writer_engine(place, checks_references=False)
    return postgres.writer_engine(place)


def _upgrade(connection: Connection, version: int, name: str) -> int:
    found = read_version(connection)
    if found is None and not is_empty(connection):
        raise DatabaseError(f"archive {name}: expected one of coastarc, got tables without a version")
    if found is not None and found > version:
        raise DatabaseError(
            f"archive {name}: expected schema version {version} or less, got {found}; "
            f"install a newer coastarc"
        )
    config = _config(connection)
    if found is not None and not inspect(connection).has_table(VERSION_TABLE):
        command.stamp(config, revision(found))
    command.upgrade(config, revision(version))
    mark_version(connection, version)
    if connection.dialect.name == "sqlite" and (faults := sqlite.reference_faults(connection)):
        raise DatabaseError(f"archive {name}: expected rows that refer to others, got {faults[0]}")
    return found or 0


def _config(connection: Connection) -> Config:
    config = Config()
    config.set_main_option("script_location", str(files("service.db") / "migrations").replace("%", "%%"))
    config.attributes["connection"] = connection
    return config


def _describe(entry: Any) -> str:
    # A list holds the changes of one column.
    kind, *rest = entry[0] if isinstance(entry, list) else entry
    return f"{kind.replace('_', ' ')} {', '.join(str(getattr(part, 'name', part)) for part in rest if part)}"
