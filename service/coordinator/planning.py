"""Plans after a start what the coordinator before this one had not planned of large campaigns."""

import logging
import threading

from service.db.engine import Unavailable
from service.store import Store

log = logging.getLogger(__name__)

#: How long it waits while the archive cannot be used [s].
OUTAGE_PAUSE_S = 5.0


def finish_planning(store: Store, stop: threading.Event) -> None:
    """Plan the rest of every campaign, or until told to stop."""
    while not stop.is_set():
        try:
            for campaign_id in store.unplanned():
                log.warning("campaign %d: planning goes on that an end of the process cut off", campaign_id)
                store.plan_rest(campaign_id, stop.is_set)
            return
        except Unavailable as error:
            store.outage.tell(error)
            stop.wait(OUTAGE_PAUSE_S)
        except Exception:
            # The same submission again has its planning done as well, and is told what is wrong.
            log.exception("planning the rest of campaigns failed")
            return
