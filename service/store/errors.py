"""What the store refuses.

StoreError(RuntimeError)
UnknownRow      no row has this id
"""


class StoreError(RuntimeError):
    """Something that the store refuses to do."""


class UnknownRow(StoreError):
    """No row has this id."""

    def __init__(self, noun: str, key: object) -> None:
        super().__init__(f"{noun} {key}: expected one that exists, got none with this id")
