"""The main loop of one pool process: jobs in on stdin, outcomes out on stdout, one JSON line each.

The process ends when stdin closes, so a parent that is killed leaves no orphan.  Nothing heavy is
imported before the first job is read, which keeps the start quick and the environment in charge.
"""

import json
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable
from functools import cache
from importlib import import_module
from inspect import signature
from typing import Any, TextIO

from workers.messages import ChainPart, Claim, Ended, JobOutcome, Reached, Sealed, Ticket, packed, sealed


class Inbox:
    """Reads requests on its own thread, so that a cancellation is seen while a solve runs."""

    def __init__(self, stream: TextIO) -> None:
        self.claims: queue.Queue[Claim] = queue.Queue()
        self._cancelled: set[Ticket] = set()
        self._stream = stream

    def start(self) -> None:
        """Start the reader thread."""
        threading.Thread(target=self._read, daemon=True).start()

    def is_cancelled(self, ticket: Ticket) -> bool:
        """Return whether the parent asked this attempt to stop."""
        return ticket in self._cancelled

    def _read(self) -> None:
        for line in self._stream:
            order: dict[str, Any] = json.loads(line)
            if "cancel" in order:
                self._cancelled.add(Ticket(*order["cancel"]))
            else:
                self.claims.put(Claim.model_validate(order["run"]))
        # The parent is gone: nothing can be reported any more.
        os._exit(0)


def runner_named(path: str) -> Callable[..., JobOutcome]:
    """Return the function that a `module:name` means."""
    module, name = path.split(":")
    runner: Callable[..., JobOutcome] = getattr(import_module(module), name)
    return runner


@cache
def hands_in(runner: Callable[..., JobOutcome]) -> bool:
    """Return whether a runner hands in the hops of a chain as they come."""
    return "hand_in" in signature(runner).parameters


def main() -> None:
    """Run jobs until stdin closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Solvers print; only outcomes may reach the parent's pipe.
    replies = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    inbox = Inbox(sys.stdin)
    inbox.start()
    runner = runner_named(sys.argv[1])
    while True:
        claim = inbox.claims.get()

        def reply(noun: str, message: Sealed[Any], ticket: Ticket = claim.ticket) -> None:
            replies.write(json.dumps({"ticket": ticket, noun: packed(message)}) + "\n")
            replies.flush()

        def hand_in(part: ChainPart, reply: Callable[..., None] = reply) -> None:
            reply("part", sealed(Reached, part))

        more = {"hand_in": hand_in} if hands_in(runner) else {}
        outcome = runner(claim.job, lambda ticket=claim.ticket: inbox.is_cancelled(ticket), **more)
        reply("outcome", sealed(Ended, outcome))


if __name__ == "__main__":
    main()
