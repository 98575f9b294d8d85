"""The tables of schema version 1: campaigns of one case per search, and what they found."""

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None

WHOLE = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
NUMBER: Any = sa.Double().with_variant(sa.REAL(), "sqlite")
FLAG = sa.Boolean().with_variant(sa.Integer(), "sqlite")
ENDINGS = "feasible infeasible numerical timeout error crash lost cancelled"


def upgrade() -> None:
    """Create them, those that others refer to first."""
    _asked()
    _found()
    _done()


def _table(name: str, *parts: Any) -> None:
    op.create_table(name, *parts, sqlite_strict=True)


def _key(name: str, kind: Any = WHOLE) -> sa.Column[Any]:
    return sa.Column(name, kind, primary_key=True)


def _whole(*names: str) -> list[sa.Column[Any]]:
    return [sa.Column(name, WHOLE, nullable=False) for name in names]


def _text(*names: str) -> list[sa.Column[Any]]:
    return [sa.Column(name, sa.Text, nullable=False) for name in names]


def _numbers(*names: str) -> list[sa.Column[Any]]:
    return [sa.Column(name, NUMBER, nullable=False) for name in names]


def _refers(name: str, target: str, kind: Any = WHOLE, **more: Any) -> sa.Column[Any]:
    return sa.Column(name, kind, sa.ForeignKey(target), **more)


def _one_of(column: str, names: str) -> sa.CheckConstraint:
    listed = ", ".join(f"'{name}'" for name in names.split())
    return sa.CheckConstraint(f"{column} IN ({listed})", name=f"known_{column}")


def _asked() -> None:
    _table(
        "campaign",
        _key("id"),
        *_text("name"),
        sa.Column("spec_hash", sa.Text, nullable=False, unique=True),
        *_text("spec"),
        *_whole("rng_seed"),
        *_text("state"),
        *_numbers("created_at"),
        sa.Column("finished_at", NUMBER),
        _one_of("state", "active paused done cancelled"),
    )
    _table("problem", _key("hash", sa.Text), *_text("definition"), *_whole("k", "n_segments"))
    _table(
        "search",
        _key("id"),
        _refers("campaign_id", "campaign.id", nullable=False),
        *_whole("position"),
        *_text("name", "strategy"),
        _refers("problem_hash", "problem.hash", sa.Text, nullable=False),
        _refers("source_id", "search.id"),
        *_text("state"),
        sa.UniqueConstraint("campaign_id", "position"),
        sa.UniqueConstraint("campaign_id", "name"),
        _one_of("state", "waiting active done cancelled"),
    )
    _table(
        "event",
        _key("id"),
        _refers("campaign_id", "campaign.id", nullable=False),
        *_text("kind", "data"),
        *_numbers("created_at"),
        _one_of("kind", "job solution search campaign"),
    )
    op.create_index("event_of_campaign", "event", ["campaign_id", "id"])


def _found() -> None:
    times = ("shooting_days", "initial_coast_days", "final_coast_days", "time_of_flight_days")
    _table(
        "solution",
        _key("id", sa.Text),
        _refers("problem_hash", "problem.hash", sa.Text, nullable=False),
        sa.Column("x", sa.LargeBinary, nullable=False),
        *_numbers("objective_kg", "propellant_kg", "delta_v_km_s", "delta_v_total_km_s", *times),
        *_text("insertion_epoch", "arrival_epoch"),
        sa.Column("defects", sa.LargeBinary, nullable=False),
        sa.Column("paper", FLAG, nullable=False),
        sa.Column("strict", FLAG, nullable=False),
        *_text("verification"),
        *_numbers("created_at"),
    )
    op.create_index("solution_order", "solution", ["problem_hash", "objective_kg", "id"])
    _table(
        "seed_link",
        _refers("solution_id", "solution.id", sa.Text, primary_key=True),
        _refers("seed_id", "solution.id", sa.Text, primary_key=True),
        _key("mapping", sa.Text),
        sa.CheckConstraint("solution_id <> seed_id", name="no_own_seed"),
    )
    _table("provenance", _key("hash", sa.Text), *_text("content"))


def _done() -> None:
    _job()
    _table(
        "attempt",
        _refers("job_id", "job.id", primary_key=True, autoincrement=False),
        sa.Column("attempt", WHOLE, primary_key=True, autoincrement=False),
        *_text("worker"),
        *_numbers("started_at"),
        sa.Column("ended_at", NUMBER),
        sa.Column("ending", sa.Text),
        sa.Column("error", sa.Text),
        _refers("provenance_hash", "provenance.hash", sa.Text),
        _one_of("ending", ENDINGS),
    )
    _solve()


def _job() -> None:
    _table(
        "job",
        _key("id"),
        _refers("search_id", "search.id", nullable=False),
        *_text("kind"),
        *_whole("case_index"),
        *_text("chain"),
        *_whole("hop", "n_hops"),
        _refers("seed_id", "solution.id", sa.Text),
        *_text("state"),
        *_whole("priority", "attempt", "n_failures"),
        sa.Column("worker", sa.Text),
        sa.Column("ending", sa.Text),
        *_numbers("created_at", "updated_at"),
        sa.UniqueConstraint("search_id", "kind", "case_index", "chain", "hop", name="job_address"),
        _one_of("state", "queued running done dead cancelled"),
        _one_of("kind", "hop map"),
        sa.CheckConstraint("(kind = 'map') = (seed_id IS NOT NULL)", name="map_has_seed"),
    )
    is_queued = sa.text("state = 'queued'")
    op.create_index(
        "job_queue", "job", ["priority", "id"], sqlite_where=is_queued, postgresql_where=is_queued
    )
    op.create_index("job_of_search", "job", ["search_id", "state"])


def _solve() -> None:
    _table(
        "solve",
        _key("id"),
        _refers("job_id", "job.id", nullable=False),
        _refers("search_id", "search.id", nullable=False),
        *_whole("attempt", "hop"),
        *_text("rng_key", "ending", "status"),
        *[sa.Column(name, FLAG, nullable=False) for name in ("is_feasible", "paper", "strict")],
        sa.Column("objective_kg", NUMBER),
        sa.Column("violation", NUMBER),
        sa.Column("defects", sa.LargeBinary, nullable=False),
        *_whole("n_iterations", "n_evaluations"),
        *_numbers("cpu_seconds", "wall_seconds"),
        sa.Column("move", sa.Text),
        _refers("solution_id", "solution.id", sa.Text),
        *_numbers("created_at"),
        sa.UniqueConstraint("job_id", "hop"),
        _one_of("ending", ENDINGS),
    )
    op.create_index("solve_of_search", "solve", ["search_id", "paper", "strict"])
    op.create_index("solve_of_solution", "solve", ["solution_id", "id"])
