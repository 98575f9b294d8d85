"""Counting by a column, which several queries do."""

from sqlalchemy import Select
from sqlalchemy.orm import Session


def counted(session: Session, query: Select[str, int]) -> dict[str, int]:
    """Return the rows (name, count) of a grouped query."""
    return {name: count for name, count in session.execute(query)}
