"""Schema version 6: whose token claimed an attempt."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"


def upgrade() -> None:
    """Add the column; what was claimed before belongs to whoever has the attempt's number, as it did."""
    op.add_column("attempt", sa.Column("claimed_by", sa.Text, nullable=True))
