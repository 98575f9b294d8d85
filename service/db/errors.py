"""Errors of opening, reading and writing an archive.

DatabaseError(RuntimeError)    no archive of this version, or none at all
    UnavailableError           a place that cannot be used now, and perhaps can be later
        WriteError             a write that the place did not take; what was stored before is kept
"""

import shutil
from pathlib import Path
from typing import Any

from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError, SQLAlchemyError, TimeoutError

from core.errors import UserError


class DatabaseError(UserError, RuntimeError):
    """A location without an archive of this version."""


class UnavailableError(DatabaseError):
    """A location that is unavailable now and may recover; what is stored is kept."""


class WriteError(UnavailableError):
    """A failed write; what was stored before is kept."""


def unusable(place: Path | str, reason: object) -> DatabaseError:
    """Return the error of a place where no archive can be."""
    return DatabaseError(
        f"archive {place}: expected an SQLite archive, got {reason}; name another folder with --data"
    )


def no_room(place: Path, error: Any) -> WriteError | None:
    """Return the error of a disk without room, if that is what kept SQLite from opening an archive."""
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    # What it cannot make beside the archive it calls a fault of the disk.
    if code == FULL or (code == IOERR and shutil.disk_usage(place.parent).free < LEAST_ROOM):
        return WriteError(
            f"archive {place}: expected room to write, got {error}; free some space and start again"
        )
    return None


def no_archive(place: Path) -> DatabaseError:
    """Return the error of a place where an archive was expected and none is."""
    return DatabaseError(
        f"archive: expected a file, got {place}, which is none; run a campaign first, or name its folder "
        "with --data"
    )


IOERR, FULL = 10, 13
#: What an archive needs to be opened: its journal, and the index of that [bytes].
LEAST_ROOM = 100_000
#: SQLite's primary codes of faults outside of our program, with what helps.
SQLITE_FAULTS = {
    5: ("to be the only writer", "stop the other program"),  # BUSY
    6: ("to be the only writer", "stop the other program"),  # LOCKED
    7: ("memory for its work", "free some memory"),  # NOMEM
    8: ("one to write in", "make it writable"),  # READONLY
    10: ("a disk that works", "look at the disk"),  # IOERR
    11: ("a whole file", "restore a backup with `coastarc db restore`"),  # CORRUPT
    13: ("room to write", "free some space"),  # FULL
    14: ("a file that opens", "look at the folder"),  # CANTOPEN
    15: ("to be the only writer", "stop the other program"),  # PROTOCOL
    26: ("an SQLite archive", "restore a backup with `coastarc db restore`"),  # NOTADB
}
#: The same by the beginnings of PostgreSQL's SQLSTATE; no state at all is no connection.
POSTGRES_FAULTS = {
    "": ("a server that answers", "start PostgreSQL"),
    "08": ("a server that answers", "start PostgreSQL"),
    "25006": ("one to write in", "connect to the primary server"),
    "40": ("to be the only writer", "stop the other program"),
    "53100": ("room to write", "free some space"),
    "53": ("a server with room", "look at its limits"),
    "55P03": ("to be the only writer", "stop the other program"),
    "57": ("a server that stays", "start PostgreSQL"),
    "58": ("a disk that works", "look at the server's log"),
    "XX001": ("whole tables", "look at the server's log"),
    "XX002": ("whole indexes", "look at the server's log"),
}
#: Every connection of this process is in use.
BUSY = ("a connection that is free", "ask less at a time")


def write_fault(place: str, error: SQLAlchemyError) -> WriteError | None:
    """Return what a driver's error says of the place, or None where it is about what was written."""
    if found := _explain(error):
        expected, reason, remedy = found
        return WriteError(
            f"archive {place}: expected {expected}, got {reason}; {remedy} and start again: "
            f"what was stored before is kept"
        )
    return None


def read_fault(place: str, error: SQLAlchemyError) -> UnavailableError | None:
    """Return what a driver's error says of the place, or None where it is about what was asked."""
    if found := _explain(error):
        expected, reason, remedy = found
        return UnavailableError(f"archive {place}: expected {expected}, got {reason}; {remedy}")
    return None


def _explain(error: SQLAlchemyError) -> tuple[str, str, str] | None:
    """Return what is expected of a place, what it said, and what helps."""
    if isinstance(error, TimeoutError):
        return BUSY[0], "none in time", BUSY[1]
    if not isinstance(error, DBAPIError):
        return None
    code = getattr(error.orig, "sqlite_errorcode", None)
    found = SQLITE_FAULTS.get(code & 0xFF) if code is not None else _known_of_postgres(error)
    if found is None:
        return None
    said = str(error.orig).strip().splitlines()
    return found[0], said[0] if said else type(error.orig).__name__, found[1]


def _known_of_postgres(error: DBAPIError) -> tuple[str, str] | None:
    cause: Any = error.orig
    if not hasattr(cause, "sqlstate"):
        return None
    state = cause.sqlstate
    # A refused connection is an error without an SQLSTATE.
    is_unconnected = state is None and isinstance(error, OperationalError | InterfaceError)
    if error.connection_invalidated or is_unconnected:
        return POSTGRES_FAULTS[""]
    beginnings = (state[:5], state[:2]) if state else ()
    return next((POSTGRES_FAULTS[begin] for begin in beginnings if begin in POSTGRES_FAULTS), None)
