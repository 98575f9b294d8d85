"""Integrity check of an archive: file, references, schema, counters and rows."""

from collections.abc import Callable
from math import isclose
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, func, select

from service.db import postgres, sqlite
from service.db.dialect import TALLIES, read_version
from service.db.engine import Place, shown
from service.db.errors import no_archive
from service.db.tables import SCHEMA_VERSION, Base, JobRow, SearchRow, SolveRow
from service.db.upgrade import differences
from service.integrity.content import unsound_rows
from service.schemas.answer import Check

REPAIR = "see what `coastarc db repair` would set aside and count anew"
RESTORE = "restore a backup with `coastarc db restore`"
UPGRADE = "bring it to this version with `coastarc db upgrade`"


def check(place: Place) -> list[Check]:
    """Return all checks of an archive; those of its content are left out where its tables are others."""
    if isinstance(place, Path):
        if not sqlite.is_file(place):
            raise no_archive(place)
        whole = _integrity(place)
        if whole.state == "failed":
            return [whole]
    else:
        whole = Check(name="file", state="ok", found=f"PostgreSQL, {shown(place)}")
    return [whole, *_of_connection(place)]


def _of_connection(place: Place) -> list[Check]:
    engine = sqlite.reader_engine(place) if isinstance(place, Path) else postgres.reader_engine(place)
    looks: list[Callable[[Connection], Check]] = [_version, _schema, _references, _totals, _rows]
    found: list[Check] = []
    try:
        with engine.connect() as connection:
            for look in looks:
                found.append(look(connection))
                if found[0].state == "failed":
                    break
            # Of rows that refer to nothing, or stand in other tables, nothing more can be said.
            if all(one.state == "ok" or one.name == "totals" for one in found):
                found.insert(-1, _content(connection))
    finally:
        engine.dispose()
    return found


def _integrity(path: Path) -> Check:
    megabytes = path.stat().st_size / 1e6
    return _check("file", f"SQLite, {megabytes:.1f} MB, {path}", sqlite.integrity_faults(path), RESTORE)


def _version(connection: Connection) -> Check:
    version = read_version(connection)
    faults = [] if version == SCHEMA_VERSION else [f"{version or 'none'}, where {SCHEMA_VERSION} is expected"]
    return _check("version", str(version), faults, UPGRADE)


def _schema(connection: Connection) -> Check:
    return _check(
        "tables", f"{len(Base.metadata.tables)} as they should be", differences(connection), RESTORE
    )


def _references(connection: Connection) -> Check:
    if connection.dialect.name == "postgresql":
        # The server lets nothing in that refers to nothing.
        return Check(name="references", state="ok", found="kept by the server")
    return _check("references", "every row's are there", sqlite.reference_faults(connection), RESTORE)


def _totals(connection: Connection) -> Check:
    jobs = select(func.count(JobRow.id)).where(JobRow.search_id == SearchRow.id).scalar_subquery()
    solves = select(func.count(SolveRow.id)).where(SolveRow.search_id == SearchRow.id).scalar_subquery()
    differ = (SearchRow.n_planned != jobs) | (SearchRow.n_solves != solves)
    names = list(connection.scalars(select(SearchRow.name).where(differ).order_by(SearchRow.id)))
    counted, kept = (
        {tuple(row[:3]): row[3] for row in connection.exec_driver_sql(query)}
        for query in (TALLIES, "SELECT search_id, noun, name, number FROM tally")
    )
    ids = {key[0] for key in counted.keys() | kept.keys() if counted.get(key, 0) != kept.get(key, 0)}
    names += connection.scalars(select(SearchRow.name).where(SearchRow.id.in_(ids)).order_by(SearchRow.id))
    names += [name for name, total, sum_ in _costs(connection) if not isclose(total, sum_, rel_tol=1e-6)]
    faults = [f"those of search {name} are not those of its rows" for name in dict.fromkeys(names)]
    return _check("totals", "every search's are those of its rows", faults, REPAIR)


def _costs(connection: Connection) -> list[Any]:
    """Return the processor time of searches, as it is kept and as it is summed up."""
    own = select(func.coalesce(func.sum(SolveRow.cpu_seconds), 0.0)).where(SolveRow.search_id == SearchRow.id)
    query = select(SearchRow.name, SearchRow.cpu_seconds, own.scalar_subquery()).order_by(SearchRow.id)
    return list(connection.execute(query).all())


def _content(connection: Connection) -> Check:
    faults = [f"{table} {', '.join(map(str, key))}: {why}" for table, key, why in unsound_rows(connection)]
    return _check("content", "every row's can be so", faults, REPAIR)


def _rows(connection: Connection) -> Check:
    counts = {
        table.name: connection.scalar(select(func.count()).select_from(table))
        for table in Base.metadata.sorted_tables
    }
    return Check(
        name="rows", state="ok", found=", ".join(f"{n} {name}" for name, n in counts.items() if n) or "none"
    )


def _check(name: str, found: str, faults: list[str], advice: str) -> Check:
    if not faults:
        return Check(name=name, state="ok", found=found)
    more = f" and {len(faults) - 1} more" if len(faults) > 1 else ""
    return Check(name=name, state="failed", found=faults[0] + more, advice=advice)
