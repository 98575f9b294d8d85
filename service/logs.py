"""Log records of a transaction, emitted once it is committed."""

import logging
from typing import Any

from sqlalchemy import event
from sqlalchemy.orm import Session

from workers.logs import IDS, JsonLines, about, configure, known

__all__ = ["IDS", "JsonLines", "about", "configure", "say"]


def say(session: Session, log: logging.Logger, level: int, message: str, **ids: Any) -> None:
    """Log on commit; nothing if the transaction is rolled back."""
    if log.isEnabledFor(level):
        extra = known(ids)
        event.listen(session, "after_commit", lambda _: log.log(level, message, extra=extra), once=True)
