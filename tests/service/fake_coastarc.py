"""The command `coastarc` with workers that answer without a solver, for tests that start real processes."""

import os
import sys
import time
from functools import partial

from service import cli
from service.cli import run as cli_run
from service.coordinator import Coordinator
from service.scheduler import LeaseSettings

#: Seconds of a lease, in place of the usual ones.
LEASE = "COASTARC_TEST_LEASE_S"
#: A file with the seconds by which the wall clock of the process is ahead; a test may change it.
CLOCK = "COASTARC_TEST_CLOCK"


def set_clock(path, real=time.time):
    offset_s = 0.0

    def now():
        nonlocal offset_s
        with open(path) as file:
            # Empty while it is being written.
            offset_s = float(file.read() or offset_s)
        return real() + offset_s

    time.time = now


def main():
    cli_run.RUNNER = f"tests.workers.fake:{sys.argv.pop(1)}"
    if CLOCK in os.environ:
        set_clock(os.environ[CLOCK])
    if LEASE in os.environ:
        lease_s = float(os.environ[LEASE])
        leases = LeaseSettings(lease_s, heartbeat_s=lease_s / 4, reap_s=lease_s / 4)
        cli_run.Coordinator = partial(Coordinator, leases=leases)
    cli.main()


if __name__ == "__main__":
    main()
