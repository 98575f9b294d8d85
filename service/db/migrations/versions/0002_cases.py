"""Schema version 2: a search is about several cases, and a map job names its own mapping."""

import json

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"

WHOLE = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    """Make the one case of every search its first, and write the search's mapping to its jobs."""
    op.create_table(
        "search_case",
        sa.Column("search_id", WHOLE, sa.ForeignKey("search.id"), primary_key=True, autoincrement=False),
        sa.Column("position", WHOLE, primary_key=True, autoincrement=False),
        sa.Column("problem_hash", sa.Text, sa.ForeignKey("problem.hash"), nullable=False),
        sqlite_strict=True,
    )
    op.execute("INSERT INTO search_case SELECT id, 0, problem_hash FROM search")
    op.add_column("job", sa.Column("mapping", sa.Text))
    _fill_mappings(op.get_bind())
    with op.batch_alter_table("job", table_kwargs={"sqlite_strict": True}) as job:
        job.create_check_constraint("map_has_mapping", "(kind = 'map') = (mapping IS NOT NULL)")
        job.create_foreign_key(
            "job_search_id_case_index_fkey",
            "search_case",
            ["search_id", "case_index"],
            ["search_id", "position"],
        )
    with op.batch_alter_table("search", table_kwargs={"sqlite_strict": True}) as search:
        search.drop_column("problem_hash")


def _fill_mappings(connection: sa.Connection) -> None:
    searches = "SELECT s.id, s.position, c.spec FROM search s JOIN campaign c ON c.id = s.campaign_id"
    fill = sa.text("UPDATE job SET mapping = :mapping WHERE search_id = :search_id AND kind = 'map'")
    for search_id, position, spec in connection.execute(sa.text(searches)).all():
        # Version 1 mapped by "reference" where nothing else was asked for.
        mapping = json.loads(spec)["search"][position].get("mapping", "reference")
        connection.execute(fill, {"mapping": mapping, "search_id": search_id})
