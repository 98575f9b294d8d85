"""What is wrong with the place of an archive, or with writing to it.

DatabaseError(RuntimeError)    no archive of this version, or none at all
    WriteFault                 a write that the place did not take; what was stored before is kept
"""

from pathlib import Path
from typing import Any

from sqlalchemy.exc import DBAPIError

from core.faults import UserError


class DatabaseError(UserError, RuntimeError):
    """A place that holds no archive of this version, or none at all."""


class WriteFault(DatabaseError):
    """A write that the place did not take; what was stored before is kept."""


def unusable(place: Path | str, reason: object) -> DatabaseError:
    """Return the error of a place where no archive can be."""
    return DatabaseError(
        f"archive {place}: expected an SQLite archive, got {reason}; name another folder with --data"
    )


def no_archive(place: Path) -> DatabaseError:
    """Return the error of a place where an archive was expected and none is."""
    return DatabaseError(
        f"archive: expected a file, got {place}, which is none; run a campaign first, or name its folder "
        "with --data"
    )


#: SQLite's primary codes of faults outside of our program, with what helps.
SQLITE_FAULTS = {
    5: ("to be the only writer", "stop the other program"),  # BUSY
    8: ("one to write in", "make it writable"),  # READONLY
    10: ("a disk that works", "look at the disk"),  # IOERR
    11: ("a whole file", "restore a backup with `coastarc db restore`"),  # CORRUPT
    13: ("room to write", "free some space"),  # FULL
    14: ("a file that opens", "look at the folder"),  # CANTOPEN
    26: ("an SQLite archive", "restore a backup with `coastarc db restore`"),  # NOTADB
}
#: The same by the beginnings of PostgreSQL's SQLSTATE; no state at all is no connection.
POSTGRES_FAULTS = {
    "": ("a server that answers", "start PostgreSQL"),
    "08": ("a server that answers", "start PostgreSQL"),
    "25006": ("one to write in", "connect to the primary server"),
    "53100": ("room to write", "free some space"),
    "53": ("a server with room", "look at its limits"),
    "55P03": ("to be the only writer", "stop the other program"),
    "57": ("a server that stays", "start PostgreSQL"),
    "58": ("a disk that works", "look at the server's log"),
}


def write_fault(place: str, error: DBAPIError) -> WriteFault | None:
    """Return what a driver's error says of the place, or None where it is about what was written."""
    found = _known(error.orig, error.connection_invalidated)
    if found is None:
        return None
    expected, remedy = found
    reason = str(error.orig).strip().splitlines()[0]
    return WriteFault(
        f"archive {place}: expected {expected}, got {reason}; {remedy} and start again: "
        f"what was stored before is kept"
    )


def _known(cause: Any, is_disconnected: bool) -> tuple[str, str] | None:
    code = getattr(cause, "sqlite_errorcode", None)
    if code is not None:
        return SQLITE_FAULTS.get(code & 0xFF)
    state = "" if is_disconnected else getattr(cause, "sqlstate", None)
    if state is None:
        return None
    return next(
        (POSTGRES_FAULTS[state[:n]] for n in (5, 2, 0) if n <= len(state) and state[:n] in POSTGRES_FAULTS),
        None,
    )
