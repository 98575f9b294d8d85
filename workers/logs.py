"""Logs: one JSON object a line, with the ids of what it is about.

A line has `time` (UTC), `level`, `logger`, `message`, and where they are known `campaign`, `job`, `attempt`
and `worker`.  Ids come from `about`, from a logging call's `extra`, or from `sign`.  What identifies somebody
to the service (tokens, cookies, passwords in addresses) is never given to a logger; should it come all the
same, as part of an error's text, it is redacted here.
"""

import json
import logging
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, TextIO

#: What a line may be about.
IDS = ("campaign", "job", "attempt", "worker")
#: For how long a repeated fault is counted instead of written [s], how many of one place in the code are
#: written whose words differ, and how many faults are remembered.
FOLD_S, MOST_OF_PLACE, MOST_SEEN = 60.0, 20, 10_000
_SECRETS = re.compile(r"coastarc_[0-9a-f]{12}_[\w-]+|(?<=://)[^/\s:@]+:[^/\s@]+(?=@)")
_about: ContextVar[Mapping[str, Any]] = ContextVar("about", default={})  # noqa: B039 - never changed
#: Ids of the whole process, for threads that know no context.
_signature: dict[str, Any] = {}


@contextmanager
def about(**ids: Any) -> Iterator[None]:
    """Bind ids to every record logged inside the block, in this thread or task."""
    token = _about.set({**_about.get(), **known(ids)})
    try:
        yield
    finally:
        _about.reset(token)


def sign(**ids: Any) -> None:
    """Bind ids to every record of this process from now on, replacing earlier ones."""
    _signature.clear()
    _signature.update(known(ids))


def configure(stream: TextIO | None = None, level: int | str = logging.INFO) -> None:
    """Log everything from `level` on to a stream or to standard error, replacing earlier handlers."""
    handler = FoldingHandler(stream or sys.stderr)
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


class FoldingHandler(logging.StreamHandler[TextIO]):
    """Logs a repeated fault once a minute, with the number of repetitions.

    The same line is folded from its second time on, lines of one place in the code from the twentieth: each
    of them may name another job, and a fault of all requests must not fill the disk on which the archive is.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(stream)
        self._clock = clock
        self._seen: dict[tuple[Any, ...], _Seen] = {}

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record unless it repeats another, and what is due of the repetitions."""
        now = self._clock()
        for key in [key for key, seen in self._seen.items() if now - seen.since >= FOLD_S]:
            self._tell(self._seen.pop(key))
        if record.levelno >= logging.WARNING and self._is_repeated(record, now):
            return
        super().emit(record)

    def close(self) -> None:
        """Write the pending repetitions."""
        for seen in self._seen.values():
            self._tell(seen)
        self._seen.clear()
        super().close()

    def _is_repeated(self, record: logging.LogRecord, now: float) -> bool:
        place = (record.name, record.levelno, str(record.msg))
        error = record.exc_info[1] if record.exc_info else None
        same = (*place, record.getMessage(), type(error), str(error))
        for key, most in ((same, 1), (place, MOST_OF_PLACE)):
            if key not in self._seen:
                self._seen[key] = _Seen(record.__dict__ | {"exc_info": None}, record.getMessage(), now)
            seen = self._seen[key]
            if seen.n_written >= most:
                seen.n_folded += 1
                return True
        if len(self._seen) > MOST_SEEN:
            self._seen.clear()
        for key in (same, place):
            if key in self._seen:
                self._seen[key].n_written += 1
        return False

    def _tell(self, seen: "_Seen") -> None:
        if not seen.n_folded:
            return
        message = f"{seen.n_folded} more within {FOLD_S:.0f} s like: {seen.message}"
        again = logging.makeLogRecord(seen.fields | {"msg": message, "args": None, "created": time.time()})
        super().emit(again)


@dataclass(slots=True)
class _Seen:
    """How often a fault was written and folded since a moment."""

    #: Those of the first record, without what it was about to hold on to in its traceback.
    fields: dict[str, Any]
    message: str
    since: float
    n_written: int = 0
    n_folded: int = 0


class JsonLines(logging.Formatter):
    """Writes a record as one line of JSON."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        ids = {**_signature, **_about.get(), **known(record.__dict__)}
        line: dict[str, Any] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": _redact(record.getMessage()),
            **{name: ids[name] for name in IDS if name in ids},
        }
        if record.exc_info:
            line["traceback"] = _redact(self.formatException(record.exc_info))
        return json.dumps(line, ensure_ascii=False, default=str)


def known(ids: Mapping[str, Any]) -> dict[str, Any]:
    """Return the ids that a line may carry, those without a value left out."""
    return {name: ids[name] for name in IDS if ids.get(name) is not None}


def _redact(message: str) -> str:
    return _SECRETS.sub("***", message)
