"""PostgreSQL: connections.

Writers of all processes go one after the other, as in an SQLite file: planning relies on what was planned
before, and pages that follow the ids of events rely on ids that become visible in their order.
"""

from typing import Any

from sqlalchemy import URL, Engine, create_engine, event
from sqlalchemy.orm import Session

from service.db.errors import DatabaseError

#: Names the lock of writers inside one database ("coastarc" in ASCII).
WRITER_LOCK = 0x636F617374617263
#: How long a write waits for that of another process [ms].
LOCK_TIMEOUT_MS = 30_000
#: Time limit of a connection attempt [s]; a machine that is gone does not answer at all.
CONNECT_TIMEOUT_S = 10
#: Errors of a server that is starting, stopping, recovering or full.
PASSING = ("starting up", "shutting down", "recovery", "not yet accepting", "too many", "connection slots")


def writer_engine(url: URL) -> Engine:
    """Return the engine of a writer."""
    # Each statement sees what was committed before it began; with REPEATABLE READ the one that takes the
    # lock would fix the state of before the lock was free.
    engine = _engine(url, f"-c lock_timeout={LOCK_TIMEOUT_MS}", isolation_level="READ COMMITTED")
    event.listen(engine, "begin", _on_begin)
    return engine


def reader_engine(url: URL) -> Engine:
    """Return the engine of readers, who see one state and cannot write."""
    options = "-c default_transaction_read_only=on"
    return _engine(url, options, isolation_level="REPEATABLE READ")


def server_time(session: Session) -> float:
    """Return what the server's clock says now, in seconds since 1970."""
    return float(
        session.connection().exec_driver_sql("SELECT extract(epoch FROM clock_timestamp())").scalar_one()
    )


def _engine(url: URL, options: str, **settings: Any) -> Engine:
    if given := url.query.get("options"):
        options = f"{given if isinstance(given, str) else ' '.join(given)} {options}"
    timeout = url.query.get("connect_timeout", str(CONNECT_TIMEOUT_S))
    ours = {"options": options, "application_name": "coastarc", "connect_timeout": timeout}
    url = url.update_query_dict(ours)
    try:
        # Asked first, so that a server that was started again is not taken for a fault.
        return create_engine(url, pool_pre_ping=True, **settings)
    except ModuleNotFoundError as error:
        raise DatabaseError(
            "database: expected the package psycopg for PostgreSQL, got none; "
            "install it: pip install -c constraints.txt -e '.[postgres]'"
        ) from error


def may_pass(reason: str) -> bool:
    """Return whether a server that let nobody in may do so later, by what it said.

    Only a server that is there says FATAL; who is refused by it for good has to look at name or password.
    """
    return "FATAL" not in reason or any(words in reason for words in PASSING)


def _on_begin(connection: Any) -> None:
    connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({WRITER_LOCK})")
