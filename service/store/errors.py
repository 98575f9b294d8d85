"""What the store refuses.

StoreError(RuntimeError)
UnknownRow      no row has this id
Conflict        what is stored already stands against it
    WrongState      a campaign, search or job from whose state this cannot be done
    KeyReused       an idempotency key that came with another specification before
    WorkerRefused   a worker that would not compute what the others do
OtherClaimant   a report on an attempt that another token claimed
"""

from core.errors import UserError


class StoreError(UserError, RuntimeError):
    """Something that the store refuses to do."""


class UnknownRow(StoreError):
    """No row has this id, or no row this id or name."""

    def __init__(self, noun: str, key: object, found: str = "none with this id") -> None:
        super().__init__(f"{noun} {key}: expected one that exists, got {found}")


class Conflict(StoreError):
    """What is stored already stands against it."""

    #: What a program reads in the refusal.
    code = "conflict"


class WrongState(Conflict):
    """A campaign, search or job from whose state this cannot be done."""

    code = "wrong_state"


class KeyReused(Conflict):
    """An idempotency key that came with another specification before."""

    code = "key_reused"


class WorkerRefused(Conflict):
    """A worker that would not compute what the others do."""

    code = "worker_refused"


class OtherClaimant(StoreError):
    """A report on an attempt that another token claimed."""
