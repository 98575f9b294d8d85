"""Connection limits of the web server: idle connections do not keep others out.

uvicorn bounds the time between two requests, but not that of a request's head, and accepts connections until
the process has no file left; then it could answer nobody.
"""

import asyncio

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

try:
    import resource
except ImportError:  # pragma: no cover - Windows has no such limit
    resource = None  # type: ignore[assignment]

#: How long a connection may take for the head of a request, and to end the body of one that is answered [s].
HEAD_PATIENCE_S = 10.0
#: Open connections at most, and the part of the files that a process may open.
MOST_CONNECTIONS, SHARE_OF_FILES = 8000, 0.75
#: Part of them beyond which a new one takes the place of one that waits; at all of them uvicorn answers 503.
ROOM = 0.9
#: Files that a coordinator asks for.
WANTED_FILES = 65536


def raise_file_limit() -> int:
    """Let this process and its children open as many files as they may; return how many that are."""
    if resource is None:
        return MOST_CONNECTIONS
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = WANTED_FILES if hard == resource.RLIM_INFINITY else min(WANTED_FILES, hard)
    if soft == resource.RLIM_INFINITY or soft >= wanted:
        return WANTED_FILES if soft == resource.RLIM_INFINITY else soft
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    except (ValueError, OSError):
        # Some systems have a lower limit than they say.
        return soft
    return wanted


def most_connections() -> int:
    """Return the limit of open connections that leaves files for the archive."""
    return max(16, min(MOST_CONNECTIONS, int(SHARE_OF_FILES * raise_file_limit())))


class PatientProtocol(H11Protocol):
    """HTTP/1.1 with a time limit for the head of a request, and a limit for the number of connections."""

    #: Set while nothing is asked of us: the time at which patience ends.
    _late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for a request; when there is no room, in place of the one that has waited longest."""
        super().connection_made(transport)
        self._watch()
        if self.limit_concurrency is not None and len(self.connections) > ROOM * self.limit_concurrency:
            waiting = [one for one in self.connections if isinstance(one, PatientProtocol) and one.is_waiting]
            min(waiting, key=lambda one: one.waits_until, default=self).abandon()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the time limit."""
        self._forgive()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Handle a chunk of a request."""
        super().data_received(data)
        self._watch()

    def on_response_complete(self) -> None:
        """Wait for the next request, or for the rest of a body that nobody wants."""
        super().on_response_complete()
        self._watch()

    @property
    def is_waiting(self) -> bool:
        """Whether a client has asked nothing yet."""
        return self._late is not None

    @property
    def waits_until(self) -> float:
        """When the time limit ends [time of the loop]."""
        return self._late.when() if self._late is not None else float("inf")

    def abandon(self) -> None:
        """Close a connection on which nothing is being answered."""
        self._forgive()
        if not self.transport.is_closing():
            # What is still in its buffers is sent first.
            self.transport.close()

    def _watch(self) -> None:
        """Begin or end the time limit, as the connection stands."""
        ours, theirs = self.conn.our_state, self.conn.their_state
        is_asking = theirs is h11.SEND_BODY and ours is not h11.DONE
        is_answered = ours in (h11.SEND_RESPONSE, h11.SEND_BODY) and theirs is not h11.IDLE
        if is_asking or is_answered:
            self._forgive()
        elif self._late is None and not self.transport.is_closing():
            self._late = self.loop.call_later(HEAD_PATIENCE_S, self.abandon)

    def _forgive(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None
