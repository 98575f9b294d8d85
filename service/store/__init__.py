"""Every query: what may be asked of the archive, and what may be done to it."""

from service.store.errors import StoreError, UnknownRowError
from service.store.store import Store

__all__ = ["Store", "StoreError", "UnknownRowError"]
