"""SQL that differs between SQLite and PostgreSQL, and expressions that many queries share.

Rows can be sampled evenly by their ids, the same ones each time.  The statements that recount the counters of
`service.store.statistics` from the rows are slow: they are for archives that had none, for
`coastarc db check`, and for tests.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any, cast

from sqlalchemy import Connection, Select, Table, inspect
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from service.db.tables import Base

INSERTS: dict[str, Any] = {"sqlite": sqlite.insert, "postgresql": postgresql.insert}
#: Where alembic keeps the revision; its name is the schema version in four digits.
VERSION_TABLE = "alembic_version"
VERSION_TABLE_SQL = (
    f"CREATE TABLE {VERSION_TABLE} (version_num VARCHAR(32) NOT NULL, "
    f"CONSTRAINT {VERSION_TABLE}_pkc PRIMARY KEY (version_num))"
)


def insert_new(session: Session, table: type[Base], values: dict[str, Any]) -> bool:
    """Insert a row unless its key is taken; return whether it is new."""
    flush_new(session)
    connection = session.connection()
    return connection.execute(_insert(connection.dialect.name, table), values).first() is not None


def insert_new_rows(session: Session, table: type[Base], rows: Sequence[dict[str, Any]]) -> None:
    """Insert rows unless their keys are taken, each in a fraction of the time of `insert_new`."""
    flush_new(session)
    if rows:
        connection = session.connection()
        statement = INSERTS[connection.dialect.name](plain(table)).on_conflict_do_nothing()
        connection.execute(statement, rows)


def insert_and_tell(
    session: Session, table: type[Base], rows: Sequence[dict[str, Any]], *names: str
) -> set[tuple[Any, ...]]:
    """Insert rows unless their keys are taken; return the named columns of those that are new."""
    flush_new(session)
    if not rows:
        return set()
    connection = session.connection()
    return {tuple(row) for row in connection.execute(_insert(connection.dialect.name, table, names), rows)}


def flush_new(session: Session) -> None:
    """Store the rows that are still pending, which one that is stored past the session may refer to."""
    if session.new:
        session.flush()


def plain(table: type[Base]) -> Table:
    """Return a table for statements that run past the session, which costs several times as much."""
    return cast(Table, table.__table__)


@cache
def _insert(dialect: str, table: type[Base], names: tuple[str, ...] = ()) -> Any:
    """Return an insertion that tells the named columns of what is new, its key if none is named."""
    # Made once: to build a statement takes longer than to run it.
    rows = plain(table)
    told = [rows.c[name] for name in names] or rows.primary_key
    return INSERTS[dialect](rows).on_conflict_do_nothing().returning(*told)


def is_empty(connection: Connection) -> bool:
    """Return whether a database holds no table at all."""
    return not inspect(connection).get_table_names()


def read_version(connection: Connection) -> int | None:
    """Return the schema version of an archive, or None where there is none."""
    if inspect(connection).has_table(VERSION_TABLE):
        found = connection.exec_driver_sql(f"SELECT version_num FROM {VERSION_TABLE}").scalar()
        return int(found) if found and found.isdecimal() else None
    if connection.dialect.name == "sqlite":
        # Versions 1 and 2 knew no revisions.
        return connection.exec_driver_sql("PRAGMA user_version").scalar() or None
    return None


def mark_version(connection: Connection, version: int) -> None:
    """Say in the file's header what the schema version is, where programs of versions 1 and 2 look for it."""
    if connection.dialect.name == "sqlite":
        connection.exec_driver_sql(f"PRAGMA user_version = {version}")


def create_tables(connection: Connection, version: int) -> None:
    """Make the tables of a new archive; the migrations, one after the other, make the same."""
    Base.metadata.create_all(connection)
    connection.exec_driver_sql(VERSION_TABLE_SQL)
    connection.exec_driver_sql(f"INSERT INTO {VERSION_TABLE} VALUES ('{revision(version)}')")
    mark_version(connection, version)


def revision(version: int) -> str:
    """Return the revision that makes a schema version."""
    return f"{version:04d}"


def go_on_counting(connection: Connection) -> None:
    """Advance PostgreSQL's sequences past rows inserted with their ids; SQLite needs nothing."""
    if connection.dialect.name != "postgresql":
        return
    for table in Base.metadata.sorted_tables:
        column = table.autoincrement_column
        if column is not None:
            sequence = f"pg_get_serial_sequence('{table.name}', '{column.name}')"
            greatest = f"(SELECT max({column.name}) FROM {table.name})"
            connection.exec_driver_sql(
                f"SELECT setval({sequence}, coalesce({greatest}, 1), {greatest} IS NOT NULL)"
            )


#: 2^32 divided by the golden ratio: multiples of it, modulo 2^32, are spread evenly, whatever goes round in
#: the ids, as cases and workers do.
STEP = 2654435761
SPAN = 2**32


def mixed(column: Any) -> Any:
    """Return an expression whose values lie evenly in [0, SPAN), and that both databases compute alike."""
    # Below 2^31, the product fits into 64 bits.
    return (column % 2**31) * STEP % SPAN


def is_drawn(column: Any, wanted: int, of: int) -> Any:
    """Return the condition that about `wanted` of so many rows meet."""
    return mixed(column) < SPAN * wanted // max(of, 1)


def counted(session: Session, query: Select[str, int]) -> dict[str, int]:
    """Return the rows (name, count) of a grouped query."""
    return {name: count for name, count in session.execute(query)}


_COUNTS = (
    "SELECT search_id, 'attempt', attempt.ending, count(*), 0.0 FROM attempt JOIN job ON job.id = job_id "
    "WHERE attempt.ending IS NOT NULL GROUP BY search_id, attempt.ending",
    "SELECT search_id, 'job', 'done', count(*), 0.0 FROM job WHERE state = 'done' GROUP BY search_id",
    "SELECT search_id, 'solve', ending, count(*), sum(cpu_seconds) FROM solve GROUP BY search_id, ending",
    "SELECT search_id, 'status', status, count(*), 0.0 FROM solve GROUP BY search_id, status",
    "SELECT search_id, 'level', 'paper', count(*), 0.0 FROM solve WHERE paper GROUP BY search_id",
    "SELECT search_id, 'level', 'strict', count(*), 0.0 FROM solve WHERE strict GROUP BY search_id",
    *(
        f"SELECT search_id, '{noun}', scope, count(*), 0.0 FROM (SELECT s.search_id, CASE "
        "WHEN NOT EXISTS (SELECT 1 FROM solve o WHERE o.solution_id = s.solution_id AND o.id < s.id) "
        "THEN 'archive' WHEN NOT EXISTS (SELECT 1 FROM solve o JOIN search b ON b.id = o.search_id "
        "WHERE o.solution_id = s.solution_id AND o.id < s.id AND b.campaign_id = a.campaign_id) "
        "THEN 'campaign' ELSE 'search' END AS scope FROM solve s JOIN search a ON a.id = s.search_id "
        f"WHERE s.solution_id IS NOT NULL {more} AND NOT EXISTS (SELECT 1 FROM solve o WHERE "
        "o.solution_id = s.solution_id AND o.id < s.id AND o.search_id = s.search_id)) AS first "
        "GROUP BY search_id, scope"
        for noun, more in (("solution", ""), ("strict", "AND s.strict"))
    ),
)
#: (search_id, noun, name, number, cpu_seconds), each solution counted where a solve found it first.
TALLIES = " UNION ALL ".join(_COUNTS)
#: The totals of searches.
TOTALS = (
    "UPDATE search SET n_planned = (SELECT count(*) FROM job WHERE search_id = search.id), "
    "n_solves = (SELECT count(*) FROM solve WHERE search_id = search.id), "
    "cpu_seconds = (SELECT coalesce(sum(cpu_seconds), 0.0) FROM solve WHERE search_id = search.id)"
)
FILL_TALLIES = f"INSERT INTO tally (search_id, noun, name, number, cpu_seconds) {TALLIES}"


def fill_tallies_of(search_ids: list[int]) -> str:
    """Return the statement that fills the tallies of some searches."""
    wanted = ", ".join(str(int(search_id)) for search_id in search_ids)
    return (
        "INSERT INTO tally (search_id, noun, name, number, cpu_seconds) "
        f"SELECT counted.* FROM ({TALLIES}) AS counted WHERE counted.search_id IN ({wanted})"
    )
