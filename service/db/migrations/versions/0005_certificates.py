"""Schema version 5: certificates of solutions."""

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"

NUMBER: Any = sa.Double().with_variant(sa.REAL(), "sqlite")
FLAG = sa.Boolean().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    """Make room for certificates; no solution has one yet."""
    op.create_table(
        "certificate",
        sa.Column("solution_id", sa.Text, sa.ForeignKey("solution.id"), primary_key=True),
        sa.Column("hash", sa.Text, primary_key=True),
        sa.Column("basis", sa.Text, nullable=False),
        sa.Column("level", sa.Text, nullable=False),
        sa.Column("is_sound", FLAG, nullable=False),
        sa.Column("content", sa.Text, nullable=False),
        sa.Column("made_on", sa.Text, nullable=False),
        sa.Column("made_at", NUMBER, nullable=False),
        sa.Column("cpu_seconds", NUMBER, nullable=False),
        sa.Column("checked_at", NUMBER, nullable=False),
        sa.CheckConstraint("level IN ('strict', 'paper', 'none')", name="known_level"),
        sqlite_strict=True,
    )
