"""Inconsistent rows, by the rules that outcomes and portable files are validated by.

Read as bytes and text, so that a row that no reader can read is found as well.  What depends on the version
that found a solution, its bounds and its levels in other solves, is left alone.
"""

import json
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError
from sqlalchemy import Column, Connection, LargeBinary, Row, Select, Text, select, type_coerce

from core.plain_data import content_hash
from core.problem import Problem, ProblemError, problem_from
from core.search import HopAddress
from service.archive_format.checks import is_own_verdict
from service.db.dialect import plain
from service.db.tables import (
    AttemptRow,
    Base,
    CampaignRow,
    CaseRow,
    CertificateRow,
    JobRow,
    Json,
    ProblemRow,
    ProvenanceRow,
    SearchRow,
    SolutionRow,
    SolveRow,
    Vector,
)
from service.spec import Spec, SpecError, spec_from
from service.validation import (
    JobFacts,
    ProblemFacts,
    UnsoundError,
    facts_of,
    require_hash,
    require_solution,
    require_solve,
)
from workers.certificate import CertificateContent
from workers.messages import KIND_NUMBERS, Ending, JobSettings, Provenance

#: Rows that are in memory at once.
CHUNK = 1000
#: What counts and times of a solve can reach; see `workers.messages`.
MOST_COUNTED, LONGEST_S = 10**12, 1e9

#: Columns that sound rows have finite numbers in, where they have any.
NUMBERS: dict[type[Base], tuple[str, ...]] = {
    SolveRow: ("objective_kg", "violation", "wall_seconds", "final_mass_kg", "created_at"),
    SolutionRow: ("created_at",),
    CertificateRow: ("made_at", "cpu_seconds", "checked_at"),
}


class Unsound(NamedTuple):
    """An inconsistent row."""

    table: str
    key: tuple[Any, ...]
    why: str


def unsound_rows(connection: Connection) -> Iterator[Unsound]:
    """Yield the inconsistent rows of an archive."""
    reader = _Reader(connection)
    yield from reader.provenances()
    yield from reader.solutions()
    yield from reader.solves()
    yield from reader.certificates()
    yield from reader.jobs()


class _Reader:
    """Reads an archive once, table by table."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._facts: dict[str, ProblemFacts] = {}
        self._bad_solutions: set[str] = set()
        self._bad_provenances: set[str] = set()
        #: Specifications by campaign; None where this machine cannot read one, as without its target.
        self._specs: dict[int, tuple[int, Spec | None]] = {}
        self._settings: dict[tuple[int, int], JobSettings] = {}

    def provenances(self) -> Iterator[Unsound]:
        for row in self._rows(select(*_raw(ProvenanceRow))):
            try:
                content = _load("content", row.content)
                if content_hash(content) != row.hash:
                    raise UnsoundError("expected the hash of its content, got another")
                Provenance.model_validate(content)
            except (UnsoundError, ValidationError) as error:
                self._bad_provenances.add(row.hash)
                yield Unsound("provenance", (row.hash,), _reason(error))

    def solutions(self) -> Iterator[Unsound]:
        for row in self._rows(select(*_raw(SolutionRow))):
            try:
                self._require_solution(row)
            except UnsoundError as error:
                self._bad_solutions.add(row.id)
                yield Unsound("solution", (row.id,), _reason(error))

    def _require_solution(self, row: Row[Any]) -> None:
        about = self._facts_of(row.problem_hash)
        levels = (bool(row.paper), bool(row.strict))
        x = require_solution(
            "", about, _floats("x", row.x), dict(row._mapping), _floats("defects", row.defects), levels
        )
        require_hash("", about, x, row.id)
        _load("verification", row.verification)
        _require_numbers(SolutionRow, row)

    def solves(self) -> Iterator[Unsound]:
        solve, job, search, case = plain(SolveRow).c, plain(JobRow).c, plain(SearchRow).c, plain(CaseRow).c
        attempt, solution = plain(AttemptRow).c, plain(SolutionRow).c
        is_of_attempt = (attempt.job_id == solve.job_id) & (attempt.attempt == solve.attempt)
        query = (
            select(
                *_raw(SolveRow),
                *(job[name] for name in ("kind", "case_index", "chain", "n_hops")),
                job.hop.label("first_hop"),
                job.search_id.label("search_of_job"),
                search.campaign_id,
                search.position,
                case.problem_hash,
                attempt.provenance_hash,
                solution.problem_hash.label("problem_of_solution"),
                solution.objective_kg.label("mass_of_solution"),
            )
            .join(plain(JobRow), job.id == solve.job_id)
            .join(plain(SearchRow), search.id == job.search_id)
            .join(plain(CaseRow), (case.search_id == job.search_id) & (case.position == job.case_index))
            .outerjoin(plain(AttemptRow), is_of_attempt)
            .outerjoin(plain(SolutionRow), solution.id == solve.solution_id)
            .order_by(solve.id)
        )
        for row in self._rows(query):
            try:
                self._require_solve(row)
            except UnsoundError as error:
                yield Unsound("solve", (row.id,), _reason(error))

    def _require_solve(self, row: Row[Any]) -> None:
        if row.search_id != row.search_of_job:
            raise UnsoundError(f"expected the search of its job, got {row.search_id}")
        if row.provenance_hash is None or row.provenance_hash in self._bad_provenances:
            raise UnsoundError("expected an attempt with a provenance, got none")
        _require_numbers(SolveRow, row)
        if not 0 <= row.wall_seconds <= LONGEST_S:
            raise UnsoundError(f"expected wall_seconds up to {LONGEST_S:g}, got {row.wall_seconds:g}")
        if not (0 <= row.n_iterations <= MOST_COUNTED and 0 <= row.n_evaluations <= MOST_COUNTED):
            raise UnsoundError(f"expected n_iterations and n_evaluations up to {MOST_COUNTED}, got more")
        if row.solution_id is not None:
            if row.solution_id in self._bad_solutions:
                raise UnsoundError("expected a solution that can be so, got another")
            if row.problem_of_solution != row.problem_hash or row.mass_of_solution != row.final_mass_kg:
                raise UnsoundError("expected a solution of its problem, and its final mass, got another")
        job = self._job(row)
        if job is not None:
            n_defects = _floats("defects", row.defects).size
            require_solve("", job, row, n_defects, row.solution_id is not None)

    def _job(self, row: Row[Any]) -> JobFacts | None:
        if row.campaign_id not in self._specs:
            self._specs[row.campaign_id] = self._spec(row.campaign_id)
        rng_seed, spec = self._specs[row.campaign_id]
        if spec is None:
            return None
        place = (row.campaign_id, row.position)
        if place not in self._settings:
            self._settings[place] = spec.search[row.position].settings
        kind, chain = KIND_NUMBERS[row.kind], int(row.chain, 16)
        address = HopAddress(kind, row.position, row.case_index, chain, row.first_hop)
        return JobFacts(
            self._facts_of(row.problem_hash), rng_seed, address, row.n_hops, self._settings[place]
        )

    def _spec(self, campaign_id: int) -> tuple[int, Spec | None]:
        column = plain(CampaignRow).c
        wanted = select(column.rng_seed, column.spec).where(column.id == campaign_id)
        rng_seed, fields = self._connection.execute(wanted).one()
        try:
            return rng_seed, spec_from(fields, allow_files=True)
        except SpecError:
            return rng_seed, None

    def _facts_of(self, problem_hash: str) -> ProblemFacts:
        if problem_hash not in self._facts:
            column = plain(ProblemRow).c
            wanted = select(column.definition).where(column.hash == problem_hash)
            try:
                problem = problem_from(self._connection.execute(wanted).scalar_one())
            except ProblemError as error:
                raise UnsoundError(f"expected a problem that can be read, got {error}") from error
            self._facts[problem_hash] = facts_of(problem, problem_hash)
        return self._facts[problem_hash]

    def certificates(self) -> Iterator[Unsound]:
        own, solution = plain(CertificateRow).c, plain(SolutionRow).c
        query = select(*_raw(CertificateRow), solution.problem_hash).join(
            plain(SolutionRow), solution.id == own.solution_id
        )
        for row in self._rows(query):
            try:
                _require_certificate(row, self._facts_of(row.problem_hash).problem)
            except (UnsoundError, ValidationError) as error:
                yield Unsound("certificate", (row.solution_id, row.hash), _reason(error))

    def jobs(self) -> Iterator[Unsound]:
        """Yield the jobs that ended feasible without a solve that is."""
        job, solve = plain(JobRow).c, plain(SolveRow).c
        own = (solve.job_id == job.id) & (solve.ending == Ending.FEASIBLE.value)
        lonely = select(job.id).where(
            job.ending == Ending.FEASIBLE.value, ~select(solve.id).where(own).exists()
        )
        for (key,) in self._rows(lonely):
            yield Unsound("job", (key,), "expected a feasible solve of a job that ended feasible, got none")

    def _rows(self, query: Select[Any]) -> Iterator[Row[Any]]:
        for rows in self._connection.execute(query.execution_options(yield_per=CHUNK)).partitions():
            yield from rows


def _require_certificate(row: Row[Any], problem: Problem) -> None:
    content = CertificateContent.model_validate(_load("content", row.content))
    said = (content.solution_id, content.problem_hash, content.level, content.is_sound)
    if said != (row.solution_id, row.problem_hash, row.level, bool(row.is_sound)):
        raise UnsoundError("expected the solution, the problem and the verdict of its content, got others")
    if content_hash(content.model_dump(mode="json")) != row.hash:
        raise UnsoundError("expected the hash of its content, got another")
    if not is_own_verdict(content, problem):
        raise UnsoundError(f"expected a verdict from its defects and marks, got {content.level}")
    _require_numbers(CertificateRow, row)


def _raw(table: type[Base]) -> list[Any]:
    """Return the columns of a table, vectors as bytes and JSON as text."""
    return [_as_stored(column) for column in plain(table).c]


def _as_stored(column: Column[Any]) -> Any:
    if isinstance(column.type, Vector):
        return type_coerce(column, LargeBinary).label(column.name)
    return type_coerce(column, Text).label(column.name) if isinstance(column.type, Json) else column


def _floats(name: str, content: bytes) -> np.ndarray[Any, np.dtype[np.float64]]:
    if len(content) % 8:
        raise UnsoundError(f"expected {name} of 8 bytes a number, got {len(content)} bytes")
    return np.frombuffer(content, dtype="<f8").astype(np.float64)


def _load(name: str, text: str) -> dict[str, Any]:
    try:
        found = json.loads(text, parse_constant=_refused)
    except (ValueError, RecursionError) as error:
        raise UnsoundError(f"expected {name} as JSON, got {error}") from error
    if not isinstance(found, dict):
        raise UnsoundError(f"expected {name} as a table, got {type(found).__name__}")
    return found


def _refused(word: str) -> float:
    raise ValueError(word)


def _require_numbers(table: type[Base], row: Row[Any]) -> None:
    for name in NUMBERS[table]:
        value = getattr(row, name)
        if value is not None and not math.isfinite(value):
            raise UnsoundError(f"expected a finite {name}, got {value}")


def _reason(error: Exception) -> str:
    if isinstance(error, ValidationError):
        first = error.errors(include_url=False)[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    return str(error).removeprefix(": ")
