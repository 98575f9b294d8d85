"""Every query: what may be asked of the archive, and what may be done to it."""

from service.store.store import Store, StoreError, UnknownRow

__all__ = ["Store", "StoreError", "UnknownRow"]
