"""What the archive forgets: its audit and its events would else grow for as long as a service runs.

Results, jobs and attempts are never forgotten.
"""

from sqlalchemy import ColumnElement, delete, func, select
from sqlalchemy.orm import Session

from service.db.identity import AuditRow
from service.db.tables import EventRow

DAY_S = 86400.0
#: So much of the audit stays: a busy client needs hours to write over what it did, and a year is for people.
AUDIT_ROWS, AUDIT_S = 1_000_000, 400 * DAY_S
#: Events for whoever comes back: 80 MB, and a quarter of an hour even at 400 outcomes a second.
EVENT_ROWS = 500_000
#: Rows that go at once, since other writes wait meanwhile.
STEP = 2_000


def prune(session: Session, now: float) -> int:
    """Delete the oldest rows beyond what stays, a bounded number of them; return how many."""
    is_old = AuditRow.created_at < now - AUDIT_S
    return _prune(session, AuditRow, AUDIT_ROWS, is_old) + _prune(session, EventRow, EVENT_ROWS)


def _prune(
    session: Session, table: type[AuditRow | EventRow], n_rows: int, is_old: ColumnElement[bool] | None = None
) -> int:
    # Ids grow with time, so both ends are found without counting.
    first, last = session.execute(select(func.min(table.id), func.max(table.id))).one()
    if first is None:
        return 0
    is_over = table.id <= last - n_rows
    which = is_over if is_old is None else is_over | is_old
    oldest = (table.id < first + STEP) & which & (table.id < last)
    return len(session.execute(delete(table).where(oldest).returning(table.id)).all())
