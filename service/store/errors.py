"""Errors of the store.

StoreError(RuntimeError)
UnknownRowError  no row has this id
ConflictError   what is stored already stands against it
    WrongStateError  a campaign, search or job from whose state this cannot be done
    KeyReusedError  an idempotency key that came with another specification before
    WorkerRefusedError  a worker that would not compute what the others do
OtherClaimantError  a report on an attempt that another token claimed
"""

from core.errors import UserError


class StoreError(UserError, RuntimeError):
    """Something that the store refuses to do."""


class UnknownRowError(StoreError):
    """No row has this id, or no row this id or name."""

    def __init__(self, noun: str, key: object, found: str = "none with this id") -> None:
        super().__init__(f"{noun} {key}: expected one that exists, got {found}")
        self.noun = noun


class ConflictError(StoreError):
    """A conflict with what is stored."""

    #: What a program reads in the refusal.
    code = "conflict"


class WrongStateError(ConflictError):
    """A campaign, search or job from whose state this cannot be done."""

    code = "wrong_state"


class KeyReusedError(ConflictError):
    """An idempotency key that came with another specification before."""

    code = "key_reused"


class WorkerRefusedError(ConflictError):
    """A worker that would not compute what the others do."""

    code = "worker_refused"


class OtherClaimantError(StoreError):
    """A report on an attempt that another token claimed."""
