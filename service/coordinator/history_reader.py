"""Reads the solves that pages tell of after a start, so that no page has to wait for them."""

import logging
import threading

from service.db.engine import Unavailable
from service.store import Store

log = logging.getLogger(__name__)

#: Between two pieces the requests of pages and workers have their turn [s].
PAUSE_S = 0.02
#: How long it waits while the archive cannot be used [s].
OUTAGE_PAUSE_S = 5.0


def read_history(store: Store, stop: threading.Event) -> None:
    """Read to the end of the archive, or until told to stop; afterwards pages read what is new."""
    try:
        while _read(store, stop):
            pass
    except Exception:
        # A page that asks reads on from there, and is told what is wrong.
        log.exception("reading the archive ahead failed")


def _read(store: Store, stop: threading.Event) -> bool:
    """Read a piece and wait; return whether there may be more to read."""
    try:
        return store.read_history() and not stop.wait(PAUSE_S)
    except Unavailable as error:
        store.outage.tell(error)
        return not stop.wait(OUTAGE_PAUSE_S)
