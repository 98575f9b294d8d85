"""The command of `tests.service.fake_coastarc`, changed where the chaos suite has to look inside or to set.

A report that the fence refuses leaves a line in the log, for the suite to count.
"""

import os
import sys

from service import scheduler
from service.store.store import Store
from tests.service import fake_coastarc
from workers.messages import StaleAttemptError

#: Failures after which a job is dead, in place of the usual number.
FAILURES = "COASTARC_TEST_FAILURES"
STALE_LINE = "chaos: a stale report was refused"


def noting_what_is_stale(complete_many):
    def noted(self, reports, by=None):
        try:
            return complete_many(self, reports, by)
        except StaleAttemptError:
            # Of several, each comes again by itself.
            if len(reports) == 1:
                sys.stderr.write(STALE_LINE + "\n")
                sys.stderr.flush()
            raise

    return noted


if __name__ == "__main__":
    scheduler.MAX_FAILURES = int(os.environ.get(FAILURES, scheduler.MAX_FAILURES))
    Store.complete_many = noting_what_is_stale(Store.complete_many)
    fake_coastarc.main()
