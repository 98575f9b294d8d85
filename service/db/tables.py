"""The tables of an archive.

Times are seconds since 1970 (UTC) of the coordinator's clock.  States and their changes are checked by the
database, so no program can store one that does not exist.  Column types read the same on SQLite and
PostgreSQL.
"""

import json
import struct
from collections.abc import Collection
from dataclasses import fields
from typing import Any, get_args

from pydantic import BaseModel
from sqlalchemy import (
    REAL,
    BigInteger,
    Boolean,
    CheckConstraint,
    Dialect,
    Double,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    LargeBinary,
    Text,
    UniqueConstraint,
    text,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column
from sqlalchemy.types import TypeDecorator, TypeEngine

from service.db.transitions import guard_transitions
from service.schemas.answer import CampaignState
from service.schemas.identity import Role
from service.schemas.job import JobState
from service.schemas.search import SearchState
from workers.messages import Ending

#: Eight bytes everywhere; SQLite's STRICT tables know the name REAL alone.
Number: TypeEngine[float] = Double().with_variant(REAL(), "sqlite")
#: Eight bytes as well: an rng_seed needs them, and SQLite counts rows in a column called INTEGER alone.
Whole: TypeEngine[int] = BigInteger().with_variant(Integer(), "sqlite")


def partial_index(name: str, *columns: str, where: str) -> Index:
    """Return an index of the rows that a condition admits."""
    return Index(name, *columns, sqlite_where=text(where), postgresql_where=text(where))


class Flag(TypeDecorator[bool]):
    """A boolean; 0 or 1 in SQLite, whose STRICT tables know no other."""

    impl = Boolean
    cache_ok = True

    def load_dialect_impl(self, dialect: Dialect) -> TypeEngine[Any]:
        """Choose the column's type."""
        return dialect.type_descriptor(Integer() if dialect.name == "sqlite" else Boolean())

    def process_bind_param(self, value: bool | None, dialect: Dialect) -> bool | int | None:
        if value is None:
            return None
        return int(value) if dialect.name == "sqlite" else bool(value)

    def process_result_value(self, value: Any, dialect: Dialect) -> bool | None:
        return None if value is None else bool(value)


class Json(TypeDecorator[Any]):
    """Plain data as JSON text."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: Any, dialect: Dialect) -> str | None:
        """Write; NaN and infinities are no JSON and are refused."""
        return None if value is None else json.dumps(value, allow_nan=False, separators=(",", ":"))

    def process_result_value(self, value: str | None, dialect: Dialect) -> Any:
        return None if value is None else json.loads(value)


class Vector(TypeDecorator[tuple[float, ...]]):
    """A vector of float64 as its little-endian bytes, which keep every bit."""

    impl = LargeBinary
    cache_ok = True

    def process_bind_param(self, value: Any, dialect: Dialect) -> bytes | None:
        return None if value is None else struct.pack(f"<{len(value)}d", *value)

    def process_result_value(self, value: bytes | None, dialect: Dialect) -> tuple[float, ...] | None:
        return None if value is None else struct.unpack(f"<{len(value) // 8}d", value)


#: Grows with every change of the tables; kept in SQLite's user_version.
SCHEMA_VERSION = 7

CAMPAIGN_STATES: tuple[str, ...] = get_args(CampaignState)
SEARCH_STATES: tuple[str, ...] = get_args(SearchState)
JOB_STATES: tuple[str, ...] = get_args(JobState)
ENDINGS = tuple(ending.value for ending in Ending)
#: What tallies are of.
TALLIED = ("attempt", "job", "solve", "status", "level", "solution", "strict")


def _one_of(column: str, names: tuple[str, ...]) -> CheckConstraint:
    listed = ", ".join(f"'{name}'" for name in names)
    return CheckConstraint(f"{column} IN ({listed})", name=f"known_{column}")


def _table(*rules: Any) -> tuple[Any, ...]:
    return (*rules, {"sqlite_strict": True})


class Base(DeclarativeBase):
    """Root of the tables; a float is eight bytes, text has no length."""

    type_annotation_map = {float: Number, int: Whole, str: Text, bool: Flag}  # noqa: RUF012


class CampaignRow(Base):
    """What a user submitted."""

    __tablename__ = "campaign"
    __table_args__ = _table(_one_of("state", CAMPAIGN_STATES))
    id: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str]
    spec_hash: Mapped[str] = mapped_column(unique=True)
    #: Read by itself, since it is large and rarely needed; see `service.store.cache`.
    spec: Mapped[Any] = mapped_column(Json, deferred=True)
    rng_seed: Mapped[int]
    state: Mapped[str]
    #: Lower goes first.
    priority: Mapped[int] = mapped_column(default=0, server_default="0")
    created_at: Mapped[float]
    finished_at: Mapped[float | None]


class SubmissionRow(Base):
    """What came with an idempotency key, so that a repeated request is known as one."""

    __tablename__ = "submission"
    __table_args__ = _table()
    key: Mapped[str] = mapped_column(primary_key=True)
    spec_hash: Mapped[str]
    campaign_id: Mapped[int] = mapped_column(ForeignKey("campaign.id"))
    created_at: Mapped[float]


class ProblemRow(Base):
    """A P_k with every field written out."""

    __tablename__ = "problem"
    __table_args__ = _table()
    hash: Mapped[str] = mapped_column(primary_key=True)
    definition: Mapped[Any] = mapped_column(Json)
    k: Mapped[int]
    n_segments: Mapped[int]


class SearchRow(Base):
    """One strategy of a campaign; its options are in the campaign's specification at `position`."""

    __tablename__ = "search"
    __table_args__ = _table(
        UniqueConstraint("campaign_id", "position"),
        UniqueConstraint("campaign_id", "name"),
        _one_of("state", SEARCH_STATES),
        CheckConstraint("weight > 0", name="positive_weight"),
        Index("search_of_source", "source_id"),
    )
    id: Mapped[int] = mapped_column(primary_key=True)
    campaign_id: Mapped[int] = mapped_column(ForeignKey("campaign.id"))
    position: Mapped[int]
    name: Mapped[str]
    strategy: Mapped[str]
    #: Search that the seeds come from.
    source_id: Mapped[int | None] = mapped_column(ForeignKey("search.id"))
    state: Mapped[str]
    #: Lower goes first, among searches of campaigns with equal priorities.
    priority: Mapped[int] = mapped_column(default=0, server_default="0")
    #: Its part of the workers, compared with searches of equal priority.
    weight: Mapped[float] = mapped_column(default=1.0, server_default="1")
    #: Processor time per weight that it has had, raised to that of the others when it joins them [s].
    served_s: Mapped[float] = mapped_column(default=0.0, server_default="0")
    #: Totals of its jobs and solves, counted as they come.
    n_planned: Mapped[int] = mapped_column(default=0, server_default="0")
    n_solves: Mapped[int] = mapped_column(default=0, server_default="0")
    cpu_seconds: Mapped[float] = mapped_column(default=0.0, server_default="0")


class TallyRow(Base):
    """How many rows of one kind a search has, counted as they come: to count a million takes a second."""

    __tablename__ = "tally"
    __table_args__ = _table(_one_of("noun", TALLIED))
    search_id: Mapped[int] = mapped_column(ForeignKey("search.id"), primary_key=True)
    noun: Mapped[str] = mapped_column(primary_key=True)
    #: Which of them; see `service.store.statistics`.
    name: Mapped[str] = mapped_column(primary_key=True)
    number: Mapped[int]
    cpu_seconds: Mapped[float]


class CaseRow(Base):
    """One of the problems that a search is about; jobs name it by its position."""

    __tablename__ = "search_case"
    __table_args__ = _table()
    search_id: Mapped[int] = mapped_column(ForeignKey("search.id"), primary_key=True)
    position: Mapped[int] = mapped_column(primary_key=True)
    problem_hash: Mapped[str] = mapped_column(ForeignKey("problem.hash"))


class JobRow(Base):
    """The unit that is dispatched.  Its address is unique, so planning twice is harmless."""

    __tablename__ = "job"
    __table_args__ = _table(
        UniqueConstraint("search_id", "kind", "case_index", "chain", "hop", name="job_address"),
        _one_of("state", JOB_STATES),
        _one_of("kind", ("hop", "map")),
        ForeignKeyConstraint(["search_id", "case_index"], ["search_case.search_id", "search_case.position"]),
        CheckConstraint("(kind = 'map') = (seed_id IS NOT NULL)", name="map_has_seed"),
        CheckConstraint("(kind = 'map') = (mapping IS NOT NULL)", name="map_has_mapping"),
        CheckConstraint("(state = 'running') = (lease_until IS NOT NULL)", name="running_has_lease"),
        CheckConstraint("NOT is_cancelling OR state = 'running'", name="cancelling_runs"),
        partial_index("job_queue", "search_id", "priority", "id", where="state = 'queued'"),
        partial_index("job_lease", "lease_until", where="state = 'running'"),
        partial_index("job_of_worker", "worker", where="state = 'running'"),
        partial_index("job_dead", "id", where="state = 'dead'"),
        Index("job_of_search", "search_id", "state"),
    )
    id: Mapped[int] = mapped_column(primary_key=True)
    search_id: Mapped[int] = mapped_column(ForeignKey("search.id"))
    kind: Mapped[str]
    case_index: Mapped[int]
    #: 32 hexadecimal digits, whose text order is their order as numbers.
    chain: Mapped[str]
    #: First hop of the chain; of a map job the number of its mapping in the search.
    hop: Mapped[int]
    n_hops: Mapped[int]
    seed_id: Mapped[str | None] = mapped_column(ForeignKey("solution.id"))
    #: The one concrete mapping of the seed.
    mapping: Mapped[str | None]
    state: Mapped[str]
    #: Lower goes first, within its search.
    priority: Mapped[int]
    #: Only grows: the fence that a late report does not pass.
    attempt: Mapped[int]
    n_failures: Mapped[int]
    #: Not handed out before, after a failure.
    not_before: Mapped[float] = mapped_column(default=0.0, server_default="0")
    #: Set while it runs alone.
    lease_until: Mapped[float | None]
    #: Its worker is told with the next heartbeat.
    is_cancelling: Mapped[bool] = mapped_column(default=False, server_default="0")
    worker: Mapped[str | None]
    ending: Mapped[str | None]
    #: Where a chain whose first hops are handed in goes on (`workers.messages.ChainPlace`); read only then.
    place: Mapped[Any] = mapped_column(Json, nullable=True, deferred=True)
    created_at: Mapped[float]
    updated_at: Mapped[float]


class ProvenanceRow(Base):
    """Code, packages, kernels and host of attempts; the same ones are stored once."""

    __tablename__ = "provenance"
    __table_args__ = _table()
    hash: Mapped[str] = mapped_column(primary_key=True)
    content: Mapped[Any] = mapped_column(Json)


class AttemptRow(Base):
    """One dispatch of a job; open while `ending` is NULL."""

    __tablename__ = "attempt"
    __table_args__ = _table(
        _one_of("ending", ENDINGS),
        # Begins with the end, since a window of time is about what ended in it and what is open; with the
        # rest of what a sample is taken by, rows that are left out are not read.
        Index("attempt_ended", "ended_at", "started_at", "job_id"),
    )
    job_id: Mapped[int] = mapped_column(ForeignKey("job.id"), primary_key=True)
    attempt: Mapped[int] = mapped_column(primary_key=True)
    worker: Mapped[str]
    #: Name of the token that claimed it: nobody else extends or ends it; NULL if nobody asked for one.
    claimed_by: Mapped[str | None]
    started_at: Mapped[float]
    ended_at: Mapped[float | None]
    ending: Mapped[str | None]
    #: State that the report of this attempt gave to the job; NULL if none was accepted.
    next_state: Mapped[str | None]
    error: Mapped[str | None]
    provenance_hash: Mapped[str | None] = mapped_column(ForeignKey("provenance.hash"))


class WorkerRow(Base):
    """A dispatcher with its executor, as it described itself last."""

    __tablename__ = "worker"
    __table_args__ = _table(Index("worker_seen", "seen_at"))
    name: Mapped[str] = mapped_column(primary_key=True)
    host: Mapped[str]
    executor: Mapped[str]
    slots: Mapped[int]
    code_version: Mapped[str]
    python_version: Mapped[str]
    #: What its processes need, where it measures that: processors kept busy [-], memory [B].
    cpu_cores: Mapped[float | None]
    memory_bytes: Mapped[int | None]
    host_memory_bytes: Mapped[int | None]
    created_at: Mapped[float]
    seen_at: Mapped[float]


class SolveRow(Base):
    """One NLP solve, feasible or not: a ratio without its failures is worthless."""

    __tablename__ = "solve"
    __table_args__ = _table(
        UniqueConstraint("job_id", "hop"),
        _one_of("ending", ENDINGS),
        # Solutions of a search, the most final mass first.
        partial_index(
            "solve_order",
            "search_id",
            "final_mass_kg",
            "solution_id",
            "strict",
            where="solution_id IS NOT NULL",
        ),
        Index("solve_recent", "search_id", "created_at"),
        # With what is told about the solve that first found a solution, so that its row is not read.
        partial_index(
            "solve_of_solution",
            "solution_id",
            "id",
            "search_id",
            "cpu_seconds",
            where="solution_id IS NOT NULL",
        ),
    )
    id: Mapped[int] = mapped_column(primary_key=True)
    job_id: Mapped[int] = mapped_column(ForeignKey("job.id"))
    search_id: Mapped[int] = mapped_column(ForeignKey("search.id"))
    attempt: Mapped[int]
    hop: Mapped[int]
    rng_key: Mapped[str]
    ending: Mapped[str]
    status: Mapped[str]
    #: At the strict tolerance, by the solver's own defects.
    is_feasible: Mapped[bool]
    #: At the two tolerances, by the verifier.
    paper: Mapped[bool]
    strict: Mapped[bool]
    objective_kg: Mapped[float | None]
    violation: Mapped[float | None]
    #: (1 + k, 7) row by row; NaN where a state was not finite.
    defects: Mapped[tuple[float, ...]] = mapped_column(Vector)
    n_iterations: Mapped[int]
    n_evaluations: Mapped[int]
    cpu_seconds: Mapped[float]
    wall_seconds: Mapped[float]
    move: Mapped[str | None]
    solution_id: Mapped[str | None] = mapped_column(ForeignKey("solution.id"))
    #: That of the solution, by which a search lists them.
    final_mass_kg: Mapped[float | None]
    created_at: Mapped[float]


class SolutionRow(Base):
    """A vector that the verifier found feasible; `id` is the hash of its problem and its bytes."""

    __tablename__ = "solution"
    __table_args__ = _table(
        Index("solution_order", "problem_hash", "objective_kg", "id"),
        Index("solution_by_mass", "objective_kg", "id"),
        # All that lists and pictures of the archive choose and sort by: rows with their vectors are long. In
        # order of id, as the solves of solutions are.
        Index(
            "solution_figures", "id", "delta_v_km_s", "time_of_flight_days", "objective_kg", "propellant_kg",
            "initial_coast_days", "shooting_days", "final_coast_days", "created_at", "problem_hash", "paper",
            "strict",
        ),
    )  # fmt: skip
    id: Mapped[str] = mapped_column(primary_key=True)
    problem_hash: Mapped[str] = mapped_column(ForeignKey("problem.hash"))
    x: Mapped[tuple[float, ...]] = mapped_column(Vector)
    objective_kg: Mapped[float]
    propellant_kg: Mapped[float]
    delta_v_km_s: Mapped[float]
    delta_v_total_km_s: Mapped[float]
    shooting_days: Mapped[float]
    initial_coast_days: Mapped[float]
    final_coast_days: Mapped[float]
    time_of_flight_days: Mapped[float]
    insertion_epoch: Mapped[str]
    arrival_epoch: Mapped[str]
    defects: Mapped[tuple[float, ...]] = mapped_column(Vector)
    paper: Mapped[bool]
    strict: Mapped[bool]
    verification: Mapped[Any] = mapped_column(Json)
    created_at: Mapped[float]


class CertificateRow(Base):
    """What an independent flight certified about a solution; one found again is the same row."""

    __tablename__ = "certificate"
    __table_args__ = _table(_one_of("level", ("strict", "paper", "none")))
    solution_id: Mapped[str] = mapped_column(ForeignKey("solution.id"), primary_key=True)
    #: That of its content.
    hash: Mapped[str] = mapped_column(primary_key=True)
    #: Identity of all that the content depends on beside the solution: code, packages, settings; empty where
    #: another installation made it, and this one has not found it again.
    basis: Mapped[str]
    level: Mapped[str]
    is_sound: Mapped[bool]
    content: Mapped[Any] = mapped_column(Json)
    #: Where and when it was made first, what that took, and when it was last found again.
    made_on: Mapped[str]
    made_at: Mapped[float]
    cpu_seconds: Mapped[float]
    checked_at: Mapped[float]


class SeedLinkRow(Base):
    """`seed_id` was mapped to the guess that became `solution_id`."""

    __tablename__ = "seed_link"
    __table_args__ = _table(CheckConstraint("solution_id <> seed_id", name="no_own_seed"))
    solution_id: Mapped[str] = mapped_column(ForeignKey("solution.id"), primary_key=True)
    seed_id: Mapped[str] = mapped_column(ForeignKey("solution.id"), primary_key=True)
    mapping: Mapped[str] = mapped_column(primary_key=True)


class EventRow(Base):
    """Something that happened; live pages follow the ids."""

    __tablename__ = "event"
    __table_args__ = _table(
        _one_of("kind", ("job", "solution", "search", "campaign")),
        Index("event_of_campaign", "campaign_id", "id"),
    )
    id: Mapped[int] = mapped_column(primary_key=True)
    campaign_id: Mapped[int] = mapped_column(ForeignKey("campaign.id"))
    kind: Mapped[str]
    data: Mapped[Any] = mapped_column(Json)
    created_at: Mapped[float]


for row in (CampaignRow, SearchRow, JobRow):
    guard_transitions(row.metadata.tables[row.__tablename__])


_STRICT = {"sqlite_strict": True}
_ROLES = ", ".join(f"'{role.value}'" for role in Role)
_IN_USE = text("revoked_at IS NULL")


class TokenRow(Base):
    """A token without its secret, of which only the hash is here."""

    __tablename__ = "token"
    __table_args__ = (
        CheckConstraint(f"role IN ({_ROLES})", name="known_role"),
        # A name may be given again when its token is revoked.
        Index("token_name", "name", unique=True, sqlite_where=_IN_USE, postgresql_where=_IN_USE),
        _STRICT,
    )
    #: Public part of the token.
    id: Mapped[str] = mapped_column(primary_key=True)
    name: Mapped[str]
    role: Mapped[str]
    secret_hash: Mapped[str]
    created_at: Mapped[float]
    expires_at: Mapped[float]
    revoked_at: Mapped[float | None]
    #: To the minute.
    last_used_at: Mapped[float | None]


class SessionRow(Base):
    """A browser that is signed in; it ends with its token."""

    __tablename__ = "session"
    __table_args__ = (Index("session_of_token", "token_id"), _STRICT)
    id: Mapped[str] = mapped_column(primary_key=True)
    token_id: Mapped[str] = mapped_column(ForeignKey("token.id"))
    secret_hash: Mapped[str]
    created_at: Mapped[float]
    expires_at: Mapped[float]


class AuditRow(Base):
    """One request that changed something, or was refused to."""

    __tablename__ = "audit"
    __table_args__ = (_STRICT,)
    id: Mapped[int] = mapped_column(primary_key=True)
    created_at: Mapped[float]
    #: Name of the token, `loopback`, or `nobody`.
    actor: Mapped[str]
    token_id: Mapped[str | None] = mapped_column(ForeignKey("token.id"))
    address: Mapped[str]
    method: Mapped[str]
    path: Mapped[str]
    status: Mapped[int]


def shared_columns(
    table: type[Base], model: type[BaseModel] | type[Any], *, but: Collection[str] = ()
) -> tuple[str, ...]:
    """Return the columns of a table that a model or a dataclass has too, in the table's order.

    Whoever copies them derives its list from here, so that a new column is named in the table and in the
    model alone; `but` names those that are converted or come from elsewhere.
    """
    known = model.model_fields if issubclass(model, BaseModel) else {one.name for one in fields(model)}
    return tuple(name for name in table.__table__.columns.keys() if name in known and name not in but)
