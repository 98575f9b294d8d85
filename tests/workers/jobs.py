"""Jobs to test with."""

from core.problem import load_problem
from workers.job import Address, HopJob, Settings

PROBLEM = load_problem("ppe-drm3")


def hop_job(chain=0, n_hops=1, **changes):
    fields = {
        "problem": PROBLEM.model_dump(mode="json"),
        "rng_seed": 2026,
        "address": Address(search=0, chain=chain),
        "n_hops": n_hops,
        "settings": Settings(cpu_seconds=5.0, max_iterations=3),
    }
    return HopJob(**(fields | changes))
