"""Schema version 4: what workers need, totals that are kept, and the indexes that lists are read by."""

from typing import Any

import sqlalchemy as sa
from alembic import op

from service.db.dialect import FILL_TALLIES

revision = "0004"
down_revision = "0003"

WHOLE = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
NUMBER: Any = sa.Double().with_variant(sa.REAL(), "sqlite")
STRICT = {"sqlite_strict": True}
NOUNS = "'attempt', 'job', 'solve', 'status', 'level', 'solution', 'strict'"
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
    op.create_index("solution_figures", "solution", FIGURES)
    op.create_index("solution_by_mass", "solution", ["objective_kg", "id"])
    _solves()
    _tallies()


def _solves() -> None:
    op.add_column("solve", sa.Column("final_mass_kg", NUMBER))
    op.execute(
        "UPDATE solve SET final_mass_kg = (SELECT objective_kg FROM solution WHERE id = solve.solution_id) "
        "WHERE solution_id IS NOT NULL"
    )
    op.drop_index("solve_of_search", "solve")
    op.drop_index("solve_of_solution", "solve")
    found = sa.text("solution_id IS NOT NULL")
    for name, columns in (
        ("solve_order", ["search_id", "final_mass_kg", "solution_id", "strict"]),
        ("solve_of_solution", ["solution_id", "id", "search_id", "cpu_seconds"]),
    ):
        op.create_index(name, "solve", columns, sqlite_where=found, postgresql_where=found)
    op.create_index("solve_recent", "solve", ["search_id", "created_at"])


def _tallies() -> None:
    op.create_table(
        "tally",
        sa.Column("search_id", WHOLE, sa.ForeignKey("search.id"), primary_key=True, autoincrement=False),
        sa.Column("noun", sa.Text, primary_key=True),
        sa.Column("name", sa.Text, primary_key=True),
        sa.Column("number", WHOLE, nullable=False),
        sa.Column("cpu_seconds", NUMBER, nullable=False),
        sa.CheckConstraint(f"noun IN ({NOUNS})", name="known_noun"),
        **STRICT,
    )
    op.execute(FILL_TALLIES)
