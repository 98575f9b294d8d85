"""A search whose chains really hop: by the laws of `core.search.Chain`, in a made-up landscape."""

import numpy as np

from core.search import Chain
from service.spec import spec_from
from tests.core.search.test_hopping import SMALL, outcome
from tests.service.campaigns import dispatcher_on
from tests.workers.fake import record, run_fake
from workers.executor import Inline
from workers.messages import Ending, JobOutcome, MapJob

SPEC = {
    "campaign": {"name": "hopping", "rng_seed": 5},
    "problem": {"preset": "ppe-drm3"},
    "search": [
        {
            "id": "adaptive",
            "strategy": "S(0)",
            "guesses": 120,
            "hops": 12,
            "hop_law": "pareto",
            "adaptive": True,
            "max_failures": 4,
        },
        {"id": "fresh", "strategy": "S(0)", "guesses": 24},
        {
            "id": "mapped",
            "strategy": "S(1|0)",
            "cases": [[10], [24], [40]],
            "duration_days": 1.0,
            "seeds": {"from": "fresh"},
            "mapping": ["reference", "continued"],
        },
        {
            "id": "chosen",
            "strategy": "S(1|0)",
            "cases": [[12]],
            "duration_days": 1.0,
            "seeds": {"from": "adaptive", "limit": 5},
        },
    ],
}


def submitted(store, **more):
    return store.submit(spec_from(SPEC | more))[0]


def dispatcher(store):
    return dispatcher_on(store, Inline(run_hopping))


def run_hopping(job, stop=lambda: False):
    """Answer with violations that wander downwards, and with the moves that a chain makes of them."""
    if isinstance(job, MapJob):
        return run_fake(job)
    chain = Chain(SMALL, job.laws)
    rng = np.random.default_rng([job.rng_seed, job.address.chain])
    level, solves = 0.0, []
    for hop in range(job.n_hops):
        level = rng.uniform(-1.5, 5.0) if not chain.is_hopping else level + rng.normal(-0.3, 0.8)
        violation = np.inf if rng.random() < 0.04 else 10.0**level
        made = record(job, hop, feasible_share=1.0 if violation <= 1.0 else 0.0)
        move = chain.tell(outcome(violation, made.objective_kg or 0.0))
        found = {"violation": violation if np.isfinite(violation) else None, "move": move}
        solves.append(made.model_copy(update=found | {"cpu_seconds": float(rng.lognormal(1.0, 0.8))}))
    best = Ending.FEASIBLE if any(solve.x for solve in solves) else Ending.INFEASIBLE
    return JobOutcome(ending=best, solves=tuple(solves), provenance=run_fake(job).provenance)
