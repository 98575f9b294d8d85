"""Logs: one JSON object a line, with the ids of what it is about.

A line has `time` (UTC), `level`, `logger`, `message`, and where they are known `campaign`, `job`, `attempt`
and `worker`.  Ids come from `about`, from a logging call's `extra`, or from `sign`.  What identifies somebody
to the service (tokens, cookies, passwords in addresses) is never given to a logger; should it come all the
same, as part of an error's text, it is blotted out here.
"""

import json
import logging
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from datetime import UTC, datetime
from typing import Any, TextIO

#: What a line may be about.
IDS = ("campaign", "job", "attempt", "worker")
_SECRETS = re.compile(r"coastarc_[0-9a-f]{12}_[\w-]+|(?<=://)[^/\s:@]+:[^/\s@]+(?=@)")
_about: ContextVar[Mapping[str, Any]] = ContextVar("about", default={})  # noqa: B039 - never changed
#: Ids of the whole process, for threads that know no context.
_signature: dict[str, Any] = {}


@contextmanager
def about(**ids: Any) -> Iterator[None]:
    """Give ids to every line that is logged inside, in this thread or task."""
    token = _about.set({**_about.get(), **known(ids)})
    try:
        yield
    finally:
        _about.reset(token)


def sign(**ids: Any) -> None:
    """Give ids to every line of this process from now on, instead of those that it had."""
    _signature.clear()
    _signature.update(known(ids))


def configure(stream: TextIO | None = None, level: int | str = logging.INFO) -> None:
    """Write everything from `level` on to a stream, or to standard error, in place of earlier handlers."""
    handler = logging.StreamHandler(stream or sys.stderr)
    handler.setFormatter(JsonLines())
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level)
    for name in ("uvicorn", "uvicorn.error"):
        logger = logging.getLogger(name)
        logger.handlers.clear()
        logger.propagate = True
    # One line per request says nothing that the audit and the metrics do not.
    for name in ("uvicorn.access", "httpx", "httpcore"):
        logging.getLogger(name).setLevel(logging.WARNING)


class JsonLines(logging.Formatter):
    """Writes a record as one line of JSON."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        ids = {**_signature, **_about.get(), **known(record.__dict__)}
        line: dict[str, Any] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": _blotted(record.getMessage()),
            **{name: ids[name] for name in IDS if name in ids},
        }
        if record.exc_info:
            line["traceback"] = _blotted(self.formatException(record.exc_info))
        return json.dumps(line, ensure_ascii=False, default=str)


def known(ids: Mapping[str, Any]) -> dict[str, Any]:
    """Return the ids that a line may carry, those without a value left out."""
    return {name: ids[name] for name in IDS if ids.get(name) is not None}


def _blotted(message: str) -> str:
    return _SECRETS.sub("***", message)
