"""Bounds on requests: the size of a body, finite numbers in it, and how many heavy requests run at once.

A body is read whole and bounded before a route sees it; one that is too large for memory goes to a file, when
its route asks for it.  JSON knows neither NaN nor infinities, but Python's parser takes both, and turns 1e999
into one.  Whatever computes a spiral or an orbit has threads of its own: it must not take those on which
claims, heartbeats and reads are answered.
"""

import json
import math
import re
from collections.abc import Callable
from functools import partial
from typing import Any, BinaryIO, ParamSpec, TypeVar

import anyio
import anyio.to_thread
from starlette.types import Message, Receive

from service.errors import BUSY_PAUSE_S, BodyError, BusyError

#: How long a client may take to send a body, or the next piece of one that goes to a file [s].
PATIENCE_S = 30.0
#: What can become a number that is not finite; only such bodies are parsed here as well.
_SUSPECT = re.compile(rb"NaN|Infinity|[eE]\+?\d{3}|(?<!\d)\d{300}")
#: Above this size a body is looked through on a thread, so that others are answered meanwhile [byte].
_LARGE_BYTES = 128 * 1024


class _NotFiniteError(Exception):
    """Not a finite number."""


async def read_body(receive: Receive, content_type: str, most_bytes: int) -> bytes:
    """Return the body, or raise a BodyError."""
    pieces: list[bytes] = []
    n_bytes = 0
    with anyio.move_on_after(PATIENCE_S):
        while (message := await receive())["type"] == "http.request":
            pieces.append(message.get("body", b""))
            n_bytes += len(pieces[-1])
            if n_bytes > most_bytes:
                raise BodyError(413, f"body: expected at most {most_bytes} bytes, got more")
            if not message.get("more_body", False):
                body = b"".join(pieces)
                if n_bytes > _LARGE_BYTES:
                    await anyio.to_thread.run_sync(_require_finite, body, content_type)
                else:
                    _require_finite(body, content_type)
                return body
    raise BodyError(408, f"body: expected all of it within {PATIENCE_S:.0f} s, got {n_bytes} bytes")


async def save_body(receive: Receive, most_bytes: int, file: BinaryIO) -> None:
    """Write the body to a file piece by piece, or raise a BodyError."""
    n_bytes = 0
    is_whole = False
    while not is_whole:
        message: Message = {"type": "none"}
        with anyio.move_on_after(PATIENCE_S):
            message = await receive()
        if message["type"] != "http.request":
            raise BodyError(408, f"body: expected its next piece within {PATIENCE_S:.0f} s, got none")
        piece = message.get("body", b"")
        n_bytes += len(piece)
        if n_bytes > most_bytes:
            raise BodyError(413, f"body: expected at most {most_bytes} bytes, got more")
        try:
            await anyio.to_thread.run_sync(file.write, piece)
        except OSError as error:
            raise BodyError(503, f"body: expected room for it, got {error.strerror}") from error
        is_whole = not message.get("more_body", False)


def replay_body(body: bytes, receive: Receive) -> Receive:
    """Return a `receive` that replays the body, and then what follows it."""
    first: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def again() -> Message:
        return first.pop() if first else await receive()

    return again


def _require_finite(body: bytes, content_type: str) -> None:
    if "json" not in content_type or not _SUSPECT.search(body):
        return
    try:
        json.loads(body, parse_float=_finite, parse_constant=_refuse)
    except _NotFiniteError as error:
        raise BodyError(422, f"body: expected finite numbers, got {error}") from None
    except (ValueError, RecursionError):
        # No JSON: the route says so in its own words.
        return


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        _refuse(text)
    return value


def _refuse(text: str) -> Any:
    raise _NotFiniteError(text[:40])


P = ParamSpec("P")
R = TypeVar("R")

#: Heavy requests that run at once, and those that may wait for them.
N_RUNNING, N_WAITING = 2, 8


class HeavyWork:
    """Runs heavy requests on threads of their own; used from one event loop."""

    def __init__(self, n_running: int = N_RUNNING, n_waiting: int = N_WAITING) -> None:
        self._limiter = anyio.CapacityLimiter(n_running)
        self._most = n_running + n_waiting
        self._n_inside = 0

    async def run(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Return what a function returns, or raise a BusyError at once."""
        if self._n_inside >= self._most:
            raise BusyError(
                f"submissions and checks: expected fewer than {self._most} at once, got as many; "
                f"wait {BUSY_PAUSE_S} s"
            )
        self._n_inside += 1
        try:
            return await anyio.to_thread.run_sync(partial(function, *args, **kwargs), limiter=self._limiter)
        finally:
            self._n_inside -= 1
