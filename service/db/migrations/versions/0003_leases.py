"""Schema version 3: leases, weights and totals, guarded changes of state, workers, tokens and the audit."""

import re
from typing import Any

import sqlalchemy as sa
from alembic import op

from service.db.transitions import transition_triggers

revision = "0003"
down_revision = "0002"

WHOLE = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
NUMBER: Any = sa.Double().with_variant(sa.REAL(), "sqlite")
FLAG = sa.Boolean().with_variant(sa.Integer(), "sqlite")
STRICT = {"sqlite_strict": True}
_OF_SEEDS = re.compile(r"S\((\d+)\|.*\)")


def upgrade() -> None:
    """Give running jobs a lease that has run out, and searches the totals of their rows."""
    _campaigns()
    _searches()
    _jobs()
    _identities()
    dialect = op.get_bind().dialect.name
    for noun in ("campaign", "search", "job"):
        for statement in transition_triggers(noun, dialect):
            op.execute(statement)


def _campaigns() -> None:
    op.add_column("campaign", _counted("priority", WHOLE))
    op.create_table(
        "submission",
        sa.Column("key", sa.Text, primary_key=True),
        *_text("spec_hash"),
        sa.Column("campaign_id", WHOLE, sa.ForeignKey("campaign.id"), nullable=False),
        *_numbers("created_at"),
        **STRICT,
    )
    op.create_table(
        "worker",
        sa.Column("name", sa.Text, primary_key=True),
        *_text("host", "executor"),
        sa.Column("slots", WHOLE, nullable=False),
        *_text("code_version", "python_version"),
        *_numbers("created_at", "seen_at"),
        **STRICT,
    )
    op.create_index("worker_seen", "worker", ["seen_at"])


def _searches() -> None:
    states = "'waiting', 'active', 'paused', 'done', 'cancelled'"
    with op.batch_alter_table("search", table_kwargs=STRICT) as search:
        search.drop_constraint("known_state", type_="check")
        search.create_check_constraint("known_state", f"state IN ({states})")
        for name, kind in (("priority", WHOLE), ("served_s", NUMBER), ("n_planned", WHOLE)):
            search.add_column(_counted(name, kind))
        for name, kind in (("n_solves", WHOLE), ("cpu_seconds", NUMBER)):
            search.add_column(_counted(name, kind))
        search.add_column(_counted("weight", NUMBER, "1"))
        search.create_check_constraint("positive_weight", "weight > 0")
    op.create_index("search_of_source", "search", ["source_id"])
    spent = "SELECT coalesce(sum(cpu_seconds), 0.0) FROM solve WHERE search_id = search.id"
    op.execute(
        f"UPDATE search SET served_s = ({spent}), cpu_seconds = ({spent}), "
        "n_planned = (SELECT count(*) FROM job WHERE search_id = search.id), "
        "n_solves = (SELECT count(*) FROM solve WHERE search_id = search.id)"
    )
    _put_seed_chains_first()


def _put_seed_chains_first() -> None:
    """Give S(k|k') the priority -k, which its jobs have had and new campaigns get."""
    connection = op.get_bind()
    for strategy in connection.scalars(sa.text("SELECT DISTINCT strategy FROM search")).all():
        if found := _OF_SEEDS.fullmatch(strategy):
            wanted = {"priority": -int(found[1]), "strategy": strategy}
            connection.execute(
                sa.text("UPDATE search SET priority = :priority WHERE strategy = :strategy"), wanted
            )


def _jobs() -> None:
    for column in (
        _counted("not_before", NUMBER),
        sa.Column("lease_until", NUMBER),
        _counted("is_cancelling", FLAG),
    ):
        op.add_column("job", column)
    op.execute("UPDATE job SET lease_until = updated_at WHERE state = 'running'")
    op.drop_index("job_queue", "job")
    with op.batch_alter_table("job", table_kwargs=STRICT) as job:
        job.create_check_constraint("running_has_lease", "(state = 'running') = (lease_until IS NOT NULL)")
        job.create_check_constraint("cancelling_runs", "NOT is_cancelling OR state = 'running'")
    _index("job_queue", "job", ["search_id", "priority", "id"], "state = 'queued'")
    _index("job_lease", "job", ["lease_until"], "state = 'running'")
    _index("job_of_worker", "job", ["worker"], "state = 'running'")
    op.add_column("attempt", sa.Column("next_state", sa.Text))
    op.execute(
        "UPDATE attempt SET next_state = (SELECT CASE WHEN job.attempt = attempt.attempt THEN job.state "
        "ELSE 'queued' END FROM job WHERE job.id = attempt.job_id) "
        "WHERE ending IS NOT NULL AND ending <> 'lost'"
    )


def _identities() -> None:
    op.create_table(
        "token",
        sa.Column("id", sa.Text, primary_key=True),
        *_text("name", "role", "secret_hash"),
        *_numbers("created_at", "expires_at"),
        sa.Column("revoked_at", NUMBER),
        sa.Column("last_used_at", NUMBER),
        sa.CheckConstraint("role IN ('viewer', 'submitter', 'admin', 'worker')", name="known_role"),
        **STRICT,
    )
    _index("token_name", "token", ["name"], "revoked_at IS NULL", unique=True)
    op.create_table(
        "session",
        sa.Column("id", sa.Text, primary_key=True),
        sa.Column("token_id", sa.Text, sa.ForeignKey("token.id"), nullable=False),
        *_text("secret_hash"),
        *_numbers("created_at", "expires_at"),
        **STRICT,
    )
    op.create_index("session_of_token", "session", ["token_id"])
    op.create_table(
        "audit",
        sa.Column("id", WHOLE, primary_key=True),
        *_numbers("created_at"),
        *_text("actor"),
        sa.Column("token_id", sa.Text, sa.ForeignKey("token.id")),
        *_text("address", "method", "path"),
        sa.Column("status", WHOLE, nullable=False),
        **STRICT,
    )


def _text(*names: str) -> list[sa.Column[Any]]:
    return [sa.Column(name, sa.Text, nullable=False) for name in names]


def _numbers(*names: str) -> list[sa.Column[Any]]:
    return [sa.Column(name, NUMBER, nullable=False) for name in names]


def _counted(name: str, kind: Any, start: str = "0") -> sa.Column[Any]:
    return sa.Column(name, kind, nullable=False, server_default=start)


def _index(name: str, table: str, columns: list[str], where: str, **more: Any) -> None:
    condition = sa.text(where)
    op.create_index(name, table, columns, sqlite_where=condition, postgresql_where=condition, **more)
