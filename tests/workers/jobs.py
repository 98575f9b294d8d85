"""Jobs to test with, and who takes them."""

import platform

from core.problem import load_problem
from workers.messages import Address, HopJob, JobSettings, WorkerInfo
from workers.provenance import code_version

PROBLEM = load_problem("ppe-drm3")


def hop_job(chain=0, n_hops=1, **changes):
    fields = {
        "problem": PROBLEM.model_dump(mode="json"),
        "rng_seed": 2026,
        "address": Address(search=0, chain=chain),
        "n_hops": n_hops,
        "settings": JobSettings(cpu_seconds=5.0, max_iterations=3),
    }
    return HopJob(**(fields | changes))


def worker_info(name="w", slots=1, **changes):
    """Return a worker that a coordinator takes for one of its own version."""
    fields = {
        "name": name,
        "host": "here",
        "executor": "inline",
        "slots": slots,
        "code_version": code_version(),
        "python_version": platform.python_version(),
    }
    return WorkerInfo(**(fields | changes))
