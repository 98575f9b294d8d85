"""Schema version 4: what workers need, and the indexes that the dashboard reads by."""

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"

WHOLE = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
NUMBER: Any = sa.Double().with_variant(sa.REAL(), "sqlite")
FIGURES = [
    "id", "delta_v_km_s", "time_of_flight_days", "objective_kg", "propellant_kg", "initial_coast_days",
    "shooting_days", "final_coast_days", "created_at", "problem_hash", "paper", "strict",
]  # fmt: skip


def upgrade() -> None:
    """Leave open what older workers did not measure, and make the indexes."""
    op.add_column("worker", sa.Column("cpu_cores", NUMBER))
    for name in ("memory_bytes", "host_memory_bytes"):
        op.add_column("worker", sa.Column(name, WHOLE))
    op.create_index("attempt_ended", "attempt", ["ended_at", "started_at", "job_id"])
    is_dead = sa.text("state = 'dead'")
    op.create_index("job_dead", "job", ["id"], sqlite_where=is_dead, postgresql_where=is_dead)
    op.drop_index("solve_of_search", "solve")
    op.create_index("solve_of_search", "solve", ["search_id", "paper", "strict", "objective_kg"])
    found = sa.text("solution_id IS NOT NULL")
    op.drop_index("solve_of_solution", "solve")
    op.create_index(
        "solve_of_solution",
        "solve",
        ["solution_id", "id", "search_id", "cpu_seconds"],
        sqlite_where=found,
        postgresql_where=found,
    )
    op.create_index("solution_figures", "solution", FIGURES)
