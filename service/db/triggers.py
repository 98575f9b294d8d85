"""Triggers that refuse every change of state that `service.scheduler.states` does not list.

They come with the tables and go with them; a migration that builds one of the tables anew runs the
statements again.
"""

from sqlalchemy import DDL, Table, event

from service.scheduler.states import TRANSITIONS, pairs


def transition_triggers(noun: str, dialect: str) -> list[str]:
    """Return the statements that guard the states of a table, none of which fails when run twice."""
    allowed = ", ".join(f"'{old}>{new}'" for old, new in pairs(TRANSITIONS[noun]))
    forbidden = f"NEW.state <> OLD.state AND (OLD.state || '>' || NEW.state) NOT IN ({allowed})"
    name = f"{noun}_transition"
    if dialect == "sqlite":
        return [
            f"DROP TRIGGER IF EXISTS {name}",
            f"CREATE TRIGGER {name} BEFORE UPDATE OF state ON {noun} WHEN {forbidden} "
            f"BEGIN SELECT RAISE(ABORT, '{noun}: expected a known change of state'); END",
        ]
    return [
        "CREATE OR REPLACE FUNCTION refuse_transition() RETURNS trigger AS $$ BEGIN RAISE EXCEPTION "
        "'%: expected a known change of state, got % to %', TG_TABLE_NAME, OLD.state, NEW.state "
        "USING ERRCODE = 'integrity_constraint_violation'; END $$ LANGUAGE plpgsql",
        f"DROP TRIGGER IF EXISTS {name} ON {noun}",
        f"CREATE TRIGGER {name} BEFORE UPDATE OF state ON {noun} FOR EACH ROW WHEN ({forbidden}) "
        f"EXECUTE FUNCTION refuse_transition()",
    ]


def guard_transitions(table: Table) -> None:
    """Create the triggers of a table whenever it is created."""
    for dialect in ("sqlite", "postgresql"):
        for statement in transition_triggers(table.name, dialect):
            # DDL formats its text with %.
            ddl = DDL(statement.replace("%", "%%"))  # type: ignore[no-untyped-call]
            event.listen(table, "after_create", ddl.execute_if(dialect=dialect))
