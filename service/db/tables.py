"""The tables: what was asked for, what is being done, what was found, and from which seed.

Times are seconds since 1970 (UTC) of the coordinator's clock.  States are checked by the database, so no
program can store one that does not exist.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import CheckConstraint, ForeignKey, ForeignKeyConstraint, Index, Text, UniqueConstraint, text
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

from service.db.columns import Flag, Json, Number, Vector
from workers.job import Ending

#: Grows with every change of the tables; kept in SQLite's user_version.
SCHEMA_VERSION = 2

CAMPAIGN_STATES = ("active", "paused", "done", "cancelled")
SEARCH_STATES = ("waiting", "active", "done", "cancelled")
JOB_STATES = ("queued", "running", "done", "dead", "cancelled")
ENDINGS = tuple(ending.value for ending in Ending)


def _one_of(column: str, names: tuple[str, ...]) -> CheckConstraint:
    listed = ", ".join(f"'{name}'" for name in names)
    return CheckConstraint(f"{column} IN ({listed})", name=f"known_{column}")


def _table(*rules: Any) -> tuple[Any, ...]:
    return (*rules, {"sqlite_strict": True})


class Base(DeclarativeBase):
    """Root of the tables; a float is eight bytes, text has no length."""

    type_annotation_map = {float: Number, str: Text, bool: Flag}  # noqa: RUF012


class CampaignRow(Base):
    """What a user submitted."""

    __tablename__ = "campaign"
    __table_args__ = _table(_one_of("state", CAMPAIGN_STATES))
    id: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str]
    spec_hash: Mapped[str] = mapped_column(unique=True)
    spec: Mapped[Any] = mapped_column(Json)
    rng_seed: Mapped[int]
    state: Mapped[str]
    created_at: Mapped[float]
    finished_at: Mapped[float | None]


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
    )
    id: Mapped[int] = mapped_column(primary_key=True)
    campaign_id: Mapped[int] = mapped_column(ForeignKey("campaign.id"))
    position: Mapped[int]
    name: Mapped[str]
    strategy: Mapped[str]
    #: Search that the seeds come from.
    source_id: Mapped[int | None] = mapped_column(ForeignKey("search.id"))
    state: Mapped[str]


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
        Index("job_queue", "priority", "id", sqlite_where=text("state = 'queued'")),
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
    #: Lower goes first.
    priority: Mapped[int]
    #: Only grows: the fence that a late report does not pass.
    attempt: Mapped[int]
    n_failures: Mapped[int]
    worker: Mapped[str | None]
    ending: Mapped[str | None]
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
    __table_args__ = _table(_one_of("ending", ENDINGS))
    job_id: Mapped[int] = mapped_column(ForeignKey("job.id"), primary_key=True)
    attempt: Mapped[int] = mapped_column(primary_key=True)
    worker: Mapped[str]
    started_at: Mapped[float]
    ended_at: Mapped[float | None]
    ending: Mapped[str | None]
    error: Mapped[str | None]
    provenance_hash: Mapped[str | None] = mapped_column(ForeignKey("provenance.hash"))


class SolveRow(Base):
    """One NLP solve, feasible or not: a ratio without its failures is worthless."""

    __tablename__ = "solve"
    __table_args__ = _table(
        UniqueConstraint("job_id", "hop"),
        _one_of("ending", ENDINGS),
        Index("solve_of_search", "search_id", "paper", "strict"),
        Index("solve_of_solution", "solution_id", "id"),
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
    defects: Mapped[NDArray[np.float64]] = mapped_column(Vector)
    n_iterations: Mapped[int]
    n_evaluations: Mapped[int]
    cpu_seconds: Mapped[float]
    wall_seconds: Mapped[float]
    move: Mapped[str | None]
    solution_id: Mapped[str | None] = mapped_column(ForeignKey("solution.id"))
    created_at: Mapped[float]


class SolutionRow(Base):
    """A vector that the verifier found feasible; `id` is the hash of its problem and its bytes."""

    __tablename__ = "solution"
    __table_args__ = _table(Index("solution_order", "problem_hash", "objective_kg", "id"))
    id: Mapped[str] = mapped_column(primary_key=True)
    problem_hash: Mapped[str] = mapped_column(ForeignKey("problem.hash"))
    x: Mapped[NDArray[np.float64]] = mapped_column(Vector)
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
    defects: Mapped[NDArray[np.float64]] = mapped_column(Vector)
    paper: Mapped[bool]
    strict: Mapped[bool]
    verification: Mapped[Any] = mapped_column(Json)
    created_at: Mapped[float]


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
