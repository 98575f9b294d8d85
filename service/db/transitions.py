"""Every allowed change of state of campaigns, searches and jobs, and triggers that refuse all others.

The triggers come with the tables and go with them, so that no code path can make another change; a migration
that builds one of the tables anew runs the statements again.
"""

from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from sqlalchemy import DDL, Table, event

from service.schemas.answer import CampaignState
from service.schemas.job import JobState
from service.schemas.search import SearchState

State = TypeVar("State", bound=str)

#: From each state those that may follow it.
Transitions = Mapping[State, tuple[State, ...]]

#: A paused campaign drains: running jobs finish, and the last of them may end it.  Done ones open again
#: when a job that failed is tried once more; cancelled is for good.
CAMPAIGN: Transitions[CampaignState] = {
    "active": ("paused", "done", "cancelled"),
    "paused": ("active", "done", "cancelled"),
    "done": ("active",),
    "cancelled": (),
}
#: Waiting ones have no jobs now and may get seeds, or belong to a large campaign that is still being planned.
SEARCH: Transitions[SearchState] = {
    "waiting": ("active", "paused", "done", "cancelled"),
    "active": ("waiting", "paused", "done", "cancelled"),
    "paused": ("waiting", "active", "done", "cancelled"),
    "done": ("waiting", "active"),
    "cancelled": (),
}
#: A running job goes back to the queue when its worker is lost or gives it up; dead and cancelled ones
#: when an operator says so.
JOB: Transitions[JobState] = {
    "queued": ("running", "cancelled"),
    "running": ("done", "queued", "dead", "cancelled"),
    "done": (),
    "dead": ("queued",),
    "cancelled": ("queued",),
}
TRANSITIONS: Mapping[str, Mapping[Any, tuple[str, ...]]] = {
    "campaign": CAMPAIGN,
    "search": SEARCH,
    "job": JOB,
}

#: States in which a campaign or a search does nothing more by itself.
ENDED = ("done", "cancelled")


def sources(noun: str, new: str) -> list[str]:
    """Return the states from which one can be reached."""
    return [old for old, following in TRANSITIONS[noun].items() if new in following]


def pairs(transitions: Mapping[Any, tuple[str, ...]]) -> Iterable[tuple[str, str]]:
    """Return every change (old, new)."""
    return [(old, new) for old, following in transitions.items() for new in following]


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
