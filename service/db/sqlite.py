"""SQLite: connections, and the file systems and file states that are refused.

Reading first and writing later inside a deferred transaction fails at once when another writer came
between, whatever the time-out; so every write begins IMMEDIATE, and there is one writer.
"""

import os
import sqlite3
import stat
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

import psutil
from sqlalchemy import Engine, create_engine, event
from sqlalchemy.pool import QueuePool

from service.db.errors import DatabaseError, unusable

#: The journal is shared through memory, which a file system between machines does not share.
NETWORK_FILE_SYSTEMS = {
    "nfs", "nfs4", "cifs", "smb", "smb2", "smb3", "smbfs", "afs", "afpfs", "ncpfs", "ceph", "lustre", "gpfs",
    "beegfs", "orangefs", "pvfs2", "ocfs2", "gfs2", "davfs", "webdav", "fuse.sshfs", "fuse.glusterfs",
    "fuse.ceph", "fuse.rclone", "fuse.s3fs", "fuse.davfs2",
}  # fmt: skip
#: How long a write waits for that of another process [ms].
BUSY_TIMEOUT_MS = 5000
#: Rights of an archive and its backups: they hold tokens' hashes and all that a team has found.
PRIVATE = 0o600


def writer_engine(path: Path, *, checks_references: bool = True) -> Engine:
    """Return the engine of the one writer; tables are rebuilt without checking what refers to them."""
    make_private(path)
    engine = _engine(str(path), uri=False)
    event.listen(engine, "connect", _on_writer_connect)
    if not checks_references:
        event.listen(engine, "connect", lambda c, _: c.execute("PRAGMA foreign_keys = OFF"))
    event.listen(engine, "begin", lambda connection: connection.exec_driver_sql("BEGIN IMMEDIATE"))
    return engine


def make_private(path: Path) -> None:
    """Make the file of an archive if there is none, and leave it and its journal to its owner alone.

    SQLite gives a journal the rights of its file.
    """
    # Where there can be no file SQLite says why; what belongs to somebody else stays as it is.
    with suppress(OSError):
        os.close(os.open(path, os.O_RDWR | os.O_CREAT, PRIVATE))
    for file in (path, *(path.with_name(path.name + end) for end in ("-wal", "-shm"))):
        with suppress(OSError):
            if stat.S_IMODE(file.stat().st_mode) & ~PRIVATE:
                file.chmod(PRIVATE)


def reader_engine(path: Path) -> Engine:
    """Return the engine of readers, who cannot write."""
    engine = _engine(read_only_address(path), uri=True)
    event.listen(engine, "connect", _on_reader_connect)
    event.listen(engine, "begin", lambda connection: connection.exec_driver_sql("BEGIN"))
    return engine


def read_only_address(path: Path) -> str:
    """Return the address by which SQLite opens a file for reading alone."""
    return f"file:{quote(str(path.absolute()))}?mode=ro"


def _engine(address: str, *, uri: bool) -> Engine:
    # Not by URL: a folder may have any character in its name.
    return create_engine(
        "sqlite://",
        creator=lambda: sqlite3.connect(address, uri=uri, check_same_thread=False),
        poolclass=QueuePool,
    )


def _on_writer_connect(connection: sqlite3.Connection, _: Any) -> None:
    # We begin transactions ourselves; the driver's own rule would begin them too late.
    connection.isolation_level = None
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = NORMAL")
    connection.execute("PRAGMA foreign_keys = ON")
    connection.execute(f"PRAGMA busy_timeout = {BUSY_TIMEOUT_MS}")
    connection.execute("PRAGMA trusted_schema = OFF")


def _on_reader_connect(connection: sqlite3.Connection, _: Any) -> None:
    connection.isolation_level = None
    connection.execute("PRAGMA query_only = ON")
    connection.execute(f"PRAGMA busy_timeout = {BUSY_TIMEOUT_MS}")
    connection.execute("PRAGMA trusted_schema = OFF")


def is_file(path: Path) -> bool:
    """Return whether there is a file, or raise where nobody may look."""
    try:
        return path.is_file()
    except OSError as error:
        raise unusable(path, error.strerror) from error


def require_local(path: Path) -> None:
    """Refuse a folder that several machines share."""
    kind = file_system(path)
    if kind in NETWORK_FILE_SYSTEMS:
        raise DatabaseError(
            f"archive {path}: expected a disk of this machine, got the network file system {kind}, on which "
            f"SQLite loses data; name a local folder with --data, or use PostgreSQL"
        )


def file_system(path: Path) -> str | None:
    """Return the kind of file system that a path is on, or None where the system does not say."""
    place = Path(os.path.realpath(path))
    try:
        mounts = {Path(mount.mountpoint): mount.fstype for mount in psutil.disk_partitions(all=True)}
    except OSError:
        return None
    # The mount that is nearest holds it.
    return next((mounts[folder].lower() for folder in (place, *place.parents) if folder in mounts), None)


def was_left_open(path: Path) -> bool:
    """Return whether the last writer ended without closing: a clean end empties the journal."""
    try:
        return path.with_name(path.name + "-wal").stat().st_size > 0
    except OSError:
        return False


def integrity_faults(path: Path, most: int = 20) -> list[str]:
    """Return what SQLite finds wrong with a file, page by page and index by index."""
    connection = sqlite3.connect(read_only_address(path), uri=True)
    try:
        found = [row[0] for row in connection.execute(f"PRAGMA integrity_check({most})")]
    except sqlite3.DatabaseError as error:
        found = [str(error)]
    finally:
        connection.close()
    return [] if found == ["ok"] else found


def reference_faults(connection: Any) -> list[str]:
    """Return the rows that refer to nothing, which no write of ours leaves behind."""
    rows = connection.exec_driver_sql("PRAGMA foreign_key_check").fetchall()
    return [f"row {row[1]} of {row[0]} refers to nothing in {row[2]}" for row in rows]
