"""Repair: moves inconsistent rows from the archive to a file, and recounts the counters."""

import json
import math
import os
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from sqlalchemy import (
    Column,
    Connection,
    Engine,
    LargeBinary,
    Table,
    Text,
    and_,
    delete,
    select,
    type_coerce,
    update,
)
from sqlalchemy.sql import ColumnElement

from service.db import postgres, sqlite
from service.db.dialect import FILL_TALLIES, TOTALS, plain
from service.db.engine import Place
from service.db.errors import DatabaseError
from service.db.tables import (
    AttemptRow,
    CertificateRow,
    JobRow,
    Json,
    ProvenanceRow,
    SearchRow,
    SeedLinkRow,
    SolutionRow,
    SolveRow,
    Vector,
)
from service.integrity.content import Unsound, unsound_rows

#: Ids that one statement names.
AT_ONCE = 500
#: Tables whose rows can be set aside, what refers to others before it.
TABLES: dict[str, Table] = {
    row.__tablename__: plain(row)
    for row in (CertificateRow, SeedLinkRow, SolveRow, AttemptRow, JobRow, SolutionRow, ProvenanceRow)
}
_SOLVE, _JOB, _ATTEMPT = plain(SolveRow).c, plain(JobRow).c, plain(AttemptRow).c
_LINK, _CERTIFICATE = plain(SeedLinkRow).c, plain(CertificateRow).c
#: What is said of an attempt whose solves were set aside.
NOTE = "set aside by `coastarc db repair`; "


class Aside:
    """The rows to be set aside, each with its reason; grows by what cannot stay without them."""

    def __init__(self, connection: Connection, unsound: Iterable[Unsound]) -> None:
        self._connection = connection
        self.reasons: dict[str, dict[tuple[Any, ...], str]] = {name: {} for name in TABLES}
        #: Jobs that stay, and whose attempts can no longer be said to have ended feasible.
        self.changed: dict[int, str] = {}
        new: dict[str, list[Any]] = {"solution": [], "solve": []}
        for table, key, why in unsound:
            if table == "job":
                self.changed[key[0]] = why
                continue
            self.reasons[table][key] = why
            if table in new:
                new[table].append(key[0])
        self._without_solutions(new["solution"])
        self._without_solves(new["solve"])

    def counts(self) -> Counter[str]:
        """Return how many rows of each table it holds."""
        return Counter({table: len(rows) for table, rows in self.reasons.items() if rows})

    def _add(self, table: str, keys: Iterable[tuple[Any, ...]], why: str) -> list[Any]:
        known = self.reasons[table]
        new = [key for key in keys if key not in known]
        known.update(dict.fromkeys(new, why))
        return [key[0] for key in new]

    def _rows(self, *columns: Column[Any], where: Column[Any], among: list[Any]) -> list[tuple[Any, ...]]:
        found: list[tuple[Any, ...]] = []
        for start in range(0, len(among), AT_ONCE):
            query = select(*columns).where(where.in_(among[start : start + AT_ONCE]))
            found += [tuple(row) for row in self._connection.execute(query)]
        return found

    def _without_solutions(self, ids: list[Any]) -> None:
        """Add what refers to solutions: certificates, links, solves, and the jobs that map them."""
        if not ids:
            return
        why = "its solution is set aside"
        own = (_CERTIFICATE.solution_id, _CERTIFICATE.hash)
        self._add("certificate", self._rows(*own, where=_CERTIFICATE.solution_id, among=ids), why)
        link = (_LINK.solution_id, _LINK.seed_id, _LINK.mapping)
        for end in (_LINK.solution_id, _LINK.seed_id):
            self._add("seed_link", self._rows(*link, where=end, among=ids), why)
        solves = self._add("solve", self._rows(_SOLVE.id, where=_SOLVE.solution_id, among=ids), why)
        jobs = self._add("job", self._rows(_JOB.id, where=_JOB.seed_id, among=ids), "its seed is set aside")
        of_jobs = self._rows(_ATTEMPT.job_id, _ATTEMPT.attempt, where=_ATTEMPT.job_id, among=jobs)
        self._add("attempt", of_jobs, "its job is set aside")
        of_jobs = self._rows(_SOLVE.id, where=_SOLVE.job_id, among=jobs)
        self._without_solves(solves + self._add("solve", of_jobs, "its job is set aside"))

    def _without_solves(self, ids: list[Any]) -> None:
        """Add the solutions that no other solve found, and the jobs that have no feasible solve left."""
        jobs = {key for (key,) in self._rows(_SOLVE.job_id, where=_SOLVE.id, among=ids)}
        for job in jobs:
            self.changed.setdefault(job, "its feasible solves are set aside")
        found = self._rows(_SOLVE.solution_id, where=_SOLVE.id, among=ids)
        left = sorted({key for (key,) in found if key is not None})
        lonely = [
            (solution,)
            for solution in left
            if all(
                key in self.reasons["solve"]
                for key in self._rows(_SOLVE.id, where=_SOLVE.solution_id, among=[solution])
            )
        ]
        self._without_solutions(self._add("solution", lonely, "no solve that found it is left"))


def repair(place: Place, file: Path | None) -> Aside:
    """Return what is to be set aside; given a new file, write it there and take it out of the archive."""
    engine = _engine(place)
    try:
        with engine.begin() as connection:
            aside = Aside(connection, list(unsound_rows(connection)))
            if file is not None:
                if aside.counts() or aside.changed:
                    _write(connection, aside, file)
                    _take_out(connection, aside)
                _recount(connection)
            return aside
    finally:
        engine.dispose()


def _engine(place: Place) -> Engine:
    return sqlite.writer_engine(place) if isinstance(place, Path) else postgres.writer_engine(place)


def _write(connection: Connection, aside: Aside, file: Path) -> None:
    """Write every row that changes as it is, a line of JSON each; all is on the disk before any is gone."""
    rows = {table: dict(keys) for table, keys in aside.reasons.items()}
    for job, why in aside.changed.items():
        rows["job"].setdefault((job,), why)
        attempts = select(_ATTEMPT.job_id, _ATTEMPT.attempt).where(_ATTEMPT.job_id == job)
        for key in connection.execute(attempts):
            rows["attempt"].setdefault(tuple(key), why)
    try:
        descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as out:
            for name, keys in rows.items():
                for key, why in keys.items():
                    stored = select(*map(_as_stored, TABLES[name].c)).where(_is_row(TABLES[name], key))
                    content = {c: _plain(v) for c, v in connection.execute(stored).one()._mapping.items()}
                    out.write(json.dumps({"table": name, "why": why, "row": content}) + "\n")
            out.flush()
            os.fsync(out.fileno())
    except OSError as error:
        raise DatabaseError(f"file {file}: expected a place to write it, got {error.strerror}") from error


def _as_stored(column: Column[Any]) -> Any:
    if isinstance(column.type, Vector):
        return type_coerce(column, LargeBinary).label(column.name)
    return type_coerce(column, Text).label(column.name) if isinstance(column.type, Json) else column


def _plain(value: Any) -> Any:
    if isinstance(value, bytes | memoryview):
        return {"hex": bytes(value).hex()}
    is_odd = isinstance(value, float) and not math.isfinite(value)
    return {"number": repr(value)} if is_odd else value


def _is_row(table: Table, key: tuple[Any, ...]) -> ColumnElement[bool]:
    return and_(*(column == part for column, part in zip(table.primary_key.columns, key, strict=True)))


def _take_out(connection: Connection, aside: Aside) -> None:
    for name in ("certificate", "seed_link", "solve"):
        _delete(connection, name, aside)
    for job, why in aside.changed.items():
        _unsay(connection, job, why)
    for name in ("attempt", "job", "solution"):
        _delete(connection, name, aside)
    for (key,) in aside.reasons["provenance"]:
        mine = plain(AttemptRow).c.provenance_hash == key
        connection.execute(update(plain(AttemptRow)).where(mine).values(provenance_hash=None))
    _delete(connection, "provenance", aside)


def _delete(connection: Connection, name: str, aside: Aside) -> None:
    for key in aside.reasons[name]:
        connection.execute(delete(TABLES[name]).where(_is_row(TABLES[name], key)))


def _unsay(connection: Connection, job: int, why: str) -> None:
    """Mark a job without a feasible solve, and its last attempt, as ended with an error."""
    is_feasible = (_SOLVE.job_id == job) & (_SOLVE.ending == "feasible")
    if connection.execute(select(_SOLVE.id).where(is_feasible).limit(1)).first() is not None:
        return
    said = {"ending": "error"}
    connection.execute(update(plain(JobRow)).where(_JOB.id == job, _JOB.ending == "feasible").values(**said))
    own = (_ATTEMPT.job_id == job) & (_ATTEMPT.ending == "feasible")
    connection.execute(update(plain(AttemptRow)).where(own).values(**said, error=NOTE + why))


def _recount(connection: Connection) -> None:
    """Recount the counters; the share of a search becomes the processor time of its solves."""
    connection.exec_driver_sql("DELETE FROM tally")
    connection.exec_driver_sql(FILL_TALLIES)
    before = dict(connection.execute(select(plain(SearchRow).c.id, plain(SearchRow).c.cpu_seconds)).all())
    connection.exec_driver_sql(TOTALS)
    column = plain(SearchRow).c
    for row in connection.execute(select(column.id, column.cpu_seconds, column.weight)).all():
        if not math.isclose(before[row.id], row.cpu_seconds, rel_tol=1e-6):
            share = {"served_s": row.cpu_seconds / row.weight}
            connection.execute(update(plain(SearchRow)).where(column.id == row.id).values(**share))
