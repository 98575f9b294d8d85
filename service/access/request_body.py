"""A request's body: read whole and bounded before a route sees it, and refused if it holds no number.

One that is too large for memory goes to a file, when its route asks for it.

JSON knows neither NaN nor infinities, but Python's parser takes both, and turns 1e999 into one.
"""

import json
import math
import re
from typing import Any, BinaryIO

import anyio
from starlette.types import Message, Receive

#: How long a client may take to send a body, or the next piece of one that goes to a file [s].
PATIENCE_S = 30.0
#: What can become a number that is not finite; only such bodies are parsed here as well.
_SUSPECT = re.compile(rb"NaN|Infinity|[eE]\+?\d{3}|(?<!\d)\d{300}")
#: Above this size a body is looked through on a thread, so that others are answered meanwhile [byte].
_LARGE_BYTES = 128 * 1024


class BodyFault(ValueError):
    """A body that no route will see; carries the status of the refusal."""

    def __init__(self, status: int, detail: str) -> None:
        super().__init__(detail)
        self.status = status


class _NotFinite(Exception):
    """A number that is none."""


async def read_body(receive: Receive, content_type: str, most_bytes: int) -> bytes:
    """Return the body, or raise a BodyFault."""
    pieces: list[bytes] = []
    n_bytes = 0
    with anyio.move_on_after(PATIENCE_S):
        while (message := await receive())["type"] == "http.request":
            pieces.append(message.get("body", b""))
            n_bytes += len(pieces[-1])
            if n_bytes > most_bytes:
                raise BodyFault(413, f"body: expected at most {most_bytes} bytes, got more")
            if not message.get("more_body", False):
                body = b"".join(pieces)
                if n_bytes > _LARGE_BYTES:
                    await anyio.to_thread.run_sync(_require_finite, body, content_type)
                else:
                    _require_finite(body, content_type)
                return body
    raise BodyFault(408, f"body: expected all of it within {PATIENCE_S:.0f} s, got {n_bytes} bytes")


async def save_body(receive: Receive, most_bytes: int, file: BinaryIO) -> None:
    """Write the body to a file piece by piece, or raise a BodyFault."""
    n_bytes = 0
    is_whole = False
    while not is_whole:
        message: Message = {"type": "none"}
        with anyio.move_on_after(PATIENCE_S):
            message = await receive()
        if message["type"] != "http.request":
            raise BodyFault(408, f"body: expected its next piece within {PATIENCE_S:.0f} s, got none")
        piece = message.get("body", b"")
        n_bytes += len(piece)
        if n_bytes > most_bytes:
            raise BodyFault(413, f"body: expected at most {most_bytes} bytes, got more")
        try:
            await anyio.to_thread.run_sync(file.write, piece)
        except OSError as error:
            raise BodyFault(503, f"body: expected room for it, got {error.strerror}") from error
        is_whole = not message.get("more_body", False)


def replayed(body: bytes, receive: Receive) -> Receive:
    """Return a `receive` that gives the body again, and then what follows it."""
    first: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def again() -> Message:
        return first.pop() if first else await receive()

    return again


def _require_finite(body: bytes, content_type: str) -> None:
    if "json" not in content_type or not _SUSPECT.search(body):
        return
    try:
        json.loads(body, parse_float=_finite, parse_constant=_refuse)
    except _NotFinite as error:
        raise BodyFault(422, f"body: expected finite numbers, got {error}") from None
    except (ValueError, RecursionError):
        # No JSON: the route says so in its own words.
        return


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        _refuse(text)
    return value


def _refuse(text: str) -> Any:
    raise _NotFinite(text[:40])
