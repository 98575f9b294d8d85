"""A worker without a dispatcher: it claims, and hands in what the fake runner says."""

import platform

from tests.workers.fake import run_fake
from workers.messages import WorkerInfo
from workers.provenance import code_version


def worker_info(name="node7:1", slots=8):
    return WorkerInfo(
        name=name,
        host="node7",
        executor="process",
        slots=slots,
        code_version=code_version(),
        python_version=platform.python_version(),
    )


def work_off(store):
    """Work until the queue is empty."""
    while claims := store.claim("node7:1", 8):
        for claim in claims:
            store.complete(claim.ticket, run_fake(claim.job))
