"""What SQLite says in its own way; PostgreSQL's words join here."""

from typing import Any

from sqlalchemy.dialects.sqlite import insert
from sqlalchemy.orm import Session

from service.db.tables import Base


def insert_new(session: Session, table: type[Base], values: dict[str, Any]) -> bool:
    """Insert a row unless its key is taken; return whether it is new."""
    # Flushed first, since rows that are still pending may be what this one refers to.
    session.flush()
    statement = insert(table).values(values).on_conflict_do_nothing().returning(*table.__mapper__.primary_key)
    return session.execute(statement).first() is not None
