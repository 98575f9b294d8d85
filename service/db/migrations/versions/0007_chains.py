"""Schema version 7: where chains go on whose first hops are handed in."""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"


def upgrade() -> None:
    """Add the column; chains that ran before begin at their first hop again, as they did."""
    op.add_column("job", sa.Column("place", sa.Text, nullable=True))
