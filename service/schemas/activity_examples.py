"""Examples of one search and of what is being worked on."""

from typing import Any

from pydantic import BaseModel

from service.schemas import job, search
from service.schemas.examples import AT, LATER, OUTAGE, ROBUST, SEED, SOLUTION

ATTEMPT = {
    "job_id": 17,
    "attempt": 1,
    "worker": "node7:4711",
    "campaign_id": 1,
    "search": "s1-0",
    "strategy": "S(1|0)",
    "kind": "map",
    "started_at": AT,
    "ended_at": None,
    "ending": None,
}
JOBS = {"queued": 9, "running": 8, "done": 11, "dead": 0, "cancelled": 0}
DETAIL = {
    "campaign_id": 1,
    "campaign": "quick",
    "campaign_state": "active",
    "id": 2,
    "name": "s1-0",
    "strategy": "S(1|0)",
    "state": "active",
    "priority": -1,
    "weight": 1.0,
    "k": 1,
    "seed_k": 0,
    "cases": [{"problem_hash": ROBUST, "outages": [OUTAGE]}],
    "hops": 1,
    "budget": {"guesses": None, "core_seconds": None, "solutions": None},
    "laws": None,
    "seeds": {
        "source": "s0",
        "campaign": None,
        "solution": None,
        "order": None,
        "limit": None,
        "pairing": "every",
        "tolerance": "strict",
        "any_duration": False,
        "mapping": ["continued"],
    },
    "solve_cpu_seconds": 120.0,
    "max_iterations": 1200,
    "jobs": JOBS,
    "n_guesses_planned": 28,
    "n_solves": 11,
    "n_paper": 11,
    "n_strict": 10,
    "cpu_seconds": 15.4,
    "best_solution_id": SOLUTION,
    "best_delta_v_km_s": 0.3235,
}
SOLVES = {
    "id": [42],
    "case": [0],
    "chain": [0],
    "hop": [0],
    "move": [None],
    "width": [None],
    "mapping": ["continued"],
    "ending": ["feasible"],
    "status": ["CONVERGED"],
    "verdict": ["strict"],
    "objective_kg": [13115.29],
    "delta_v_km_s": [0.3235],
    "violation": [0.4],
    "n_iterations": [63],
    "cpu_seconds": [1.4],
    "solution_id": [SOLUTION],
}
SEED_USED = {
    "id": SEED,
    "search": "s0",
    "strategy": "S(0)",
    "delta_v_km_s": 0.3196,
    "time_of_flight_days": 74.9,
}
QUEUE = {
    "at": LATER,
    "lease_s": 30.0,
    "heartbeat_s": 10.0,
    "jobs": JOBS,
    "oldest_job_id": 21,
    "oldest_queued_at": AT,
    "campaigns": [{"campaign_id": 1, "name": "quick", "state": "active", "jobs": JOBS}],
}

EXAMPLES: dict[type[BaseModel], dict[str, Any]] = {
    search.SearchDetail: DETAIL,
    search.HopsView: {
        "solves": SOLVES,
        "seeds": [SEED_USED],
        "n_shown": 1,
        "n_all": 11,
        "last": 42,
    },
    job.AttemptPage: {"since": AT, "until": LATER, "items": [ATTEMPT], "n_all": 1},
    job.AttemptsOfJob: {"items": [ATTEMPT | {"error": None}]},
    job.QueueView: QUEUE,
    job.Requeued: {"n_jobs": 3},
}
