"""What answers look like: one example for each, shown in the OpenAPI document and checked by a test."""

from typing import Any

from pydantic import BaseModel

from service.schemas import identity, problem, solution
from service.schemas.campaign import CampaignView
from service.schemas.job import EventPage, JobPage, JobView, WorkerPage
from service.schemas.problem import ProblemPage, ProblemView
from service.schemas.search import MetricsView
from service.schemas.solution import RecordPage, SeedPage
from workers.messages import ClaimAnswer, CompleteAnswer, CompleteManyAnswer, HandInAnswer, HeartbeatAnswer

SOLUTION = "63dd0ec3a1b24c7f9e5d8b6a4f2c1e07"
SEED = "1b7e9c50d3f84a6286e0b5c7d9f1a324"
PROBLEM = "0f5c0e1d9a7b4c3e8f2a6b1d0c9e7f35"
ROBUST = "7a2e4d6c8b0f1a3c5e7d9b1f3a5c7e90"
AT, LATER = "2026-11-24T09:30:00Z", "2026-11-24T11:05:12Z"
OUTAGE = {"segment": 24, "duration_days": 1.0}
#: A problem with every field written out has some forty of them.
DEFINITION: dict[str, Any] = {"n_segments": 50, "outages": [OUTAGE]}
ROWS = [[0.012, -0.004, 0.009, 1e-7, -2e-7, 5e-8, 0.0]] * 2

CAMPAIGN = {
    "id": 1,
    "name": "quick",
    "state": "active",
    "priority": 0,
    "created_at": AT,
    "finished_at": None,
    "rng_seed": 2026,
    "n_jobs": 58,
    "n_done": 41,
    "n_solves": 41,
    "n_solutions": 37,
    "best_delta_v_km_s": 0.3196,
}
SEARCH = {
    "id": 2,
    "name": "s1-0",
    "strategy": "S(1|0)",
    "state": "active",
    "priority": -1,
    "weight": 1.0,
    "k": 1,
    "cases": [{"problem_hash": ROBUST, "outages": [OUTAGE]}],
    "mapping": "continued",
    "seeds_from": "s0",
    "hops": 1,
    "jobs": {"queued": 9, "running": 8, "done": 11, "dead": 0, "cancelled": 0},
    "n_guesses_planned": 28,
    "n_solves": 11,
    "n_paper": 11,
    "n_strict": 10,
    "strict_ratio": {"value": 0.91, "low": 0.62, "high": 0.98},
    "n_solutions": 10,
    "endings": {"feasible": 11},
    "statuses": {"CONVERGED": 11},
    "best_solution_id": SOLUTION,
    "best_delta_v_km_s": 0.3235,
    "best_propellant_kg": 160.75,
    "best_final_mass_kg": 13115.29,
    "cpu_seconds": 15.4,
}
JOB = {
    "id": 17,
    "campaign_id": 1,
    "search_id": 2,
    "search": "s1-0",
    "kind": "map",
    "state": "running",
    "attempt": 1,
    "n_failures": 0,
    "not_before": None,
    "worker": "node7:4711",
    "lease_until": LATER,
    "is_cancelling": False,
    "ending": None,
    "error": None,
    "n_hops": 1,
    "seed_id": SEED,
    "created_at": AT,
    "updated_at": LATER,
}
RECORD = {
    "id": SOLUTION,
    "campaign_id": 1,
    "search_id": 2,
    "search": "s1-0",
    "strategy": "S(1|0)",
    "problem_hash": ROBUST,
    "k": 1,
    "outages": [OUTAGE],
    "objective_kg": 13115.29,
    "propellant_kg": 160.75,
    "delta_v_km_s": 0.3235,
    "delta_v_total_km_s": 3.566,
    "shooting_days": 71.3,
    "initial_coast_days": 2.1,
    "final_coast_days": 4.0,
    "time_of_flight_days": 77.4,
    "arrival_epoch": "2026-08-22T08:11:09.120",
    "insertion_epoch": "2026-08-18T08:11:09.120",
    "defects_solved": ROWS,
    "defects_verified": ROWS,
    "paper": True,
    "strict": True,
    "status": "CONVERGED",
    "n_iterations": 63,
    "n_evaluations": 88,
    "cpu_seconds": 1.4,
    "wall_seconds": 1.5,
    "rng_key": "2026/1/1/0/36604212893417/0",
    "seed_id": SEED,
    "mapping": "continued",
    "code_version": "0.1.0+1f0c5e9a7b3d",
    "package_versions": {"numpy": "2.4.6"},
    "kernel_hashes": {"de440.bsp": "a4ce9bf6"},
    "host": "node7 (x86_64, Linux)",
    "created_at": LATER,
    "is_marginal": False,
    "earth_altitude_km": 156833.3,
    "moon_altitude_km": 3945.5,
}
WORKER = {
    "name": "node7:4711",
    "host": "node7",
    "executor": "process",
    "slots": 8,
    "code_version": "0.1.0+1f0c5e9a7b3d",
    "python_version": "3.11.7",
    "cpu_cores": 7.9,
    "memory_bytes": 2_147_483_648,
    "host_memory_bytes": 34_359_738_368,
    "created_at": AT,
    "seen_at": LATER,
    "is_alive": True,
    "held": [{"job_id": 17, "attempt": 1, "lease_until": LATER}],
}
TOKEN = {
    "id": "5f0c1e9d2b7a",
    "name": "ada",
    "role": "submitter",
    "state": "active",
    "created_at": AT,
    "expires_at": "2027-02-22T09:30:00Z",
    "revoked_at": None,
    "last_used_at": LATER,
}
AUDIT = {
    "id": 9,
    "created_at": LATER,
    "actor": "ada",
    "token_id": "5f0c1e9d2b7a",
    "address": "10.0.0.9",
    "method": "POST",
    "path": "/api/v1/campaigns",
    "status": 201,
}
SEEDING = {
    "seed_id": SEED,
    "seed_problem_hash": PROBLEM,
    "seed_outages": [],
    "delta_v_km_s": 0.3196,
    "time_of_flight_days": 74.9,
    "strict": True,
    "problem_hash": ROBUST,
    "outages": [OUTAGE],
    "mapping": "continued",
    "job_id": 17,
    "job_state": "running",
}
POINTS = {
    "n": 706,
    "front": [0],
    "strategies": ["S(0)", "S(1|0)"],
    "id": [SOLUTION],
    "strategy": [1],
    "k": [1],
    "strict": [True],
    "delta_v_km_s": [0.3235],
    "time_of_flight_days": [77.4],
    "initial_coast_days": [2.1],
    "shooting_days": [71.3],
    "final_coast_days": [4.0],
    "propellant_kg": [160.75],
    "cpu_seconds": [1.4],
}
CLUSTER = {
    "best_id": SOLUTION,
    "size": 12,
    "strategies": {"S(0)": 2, "S(1|0)": 10},
    "min_delta_v_km_s": 0.3235,
    "max_delta_v_km_s": 0.3302,
    "min_time_of_flight_days": 76.9,
    "max_time_of_flight_days": 78.2,
    "mean_distance": 0.021,
    "max_distance": 0.047,
}
CHOICES = {
    "campaigns": [{"id": 1, "name": "quick"}],
    "searches": ["s0", "s1-0"],
    "strategies": ["S(0)", "S(1|0)"],
    "k": [0, 1],
    "segments": [24],
    "durations_days": [1.0],
}
ITEM = {"hash": ROBUST, "k": 1, "outages": [OUTAGE], "n_segments": 50}
NODE = {"search": "s1-0", "strategy": "S(1|0)", "k": 1, "delta_v_km_s": 0.3235, "strict": True}
EVENT = {"id": 42, "campaign_id": 1, "kind": "search", "created_at": LATER}
SIGNED_IN = "coastarc_5f0c1e9d2b7a_" + 43 * "x"
HELD = {"job_id": 17, "attempt": 1}
RELATIVE = ITEM | {"hash": PROBLEM, "k": 0, "outages": [], "outage": OUTAGE, "n_solutions": 28}
RELATIVE |= {"best_delta_v_km_s": 0.3196}
SHAPE = {"outage": None, "n_segments": 50, "first_variable": 0, "n_variables": 154, "matchpoint": 26}
SHAPE |= {"leaves": None}
PROVENANCE = ("code_version", "package_versions", "kernel_hashes", "host", "status", "cpu_seconds")
HOP_JOB = {
    "kind": "hop",
    "problem": {"n_segments": 50, "outages": []},
    "rng_seed": 2026,
    "address": {"search": 0, "case": 0, "chain": 12, "hop": 0},
    "n_hops": 1,
}

EXAMPLES: dict[type[BaseModel], dict[str, Any]] = {
    CampaignView: CAMPAIGN
    | {
        "problem": DEFINITION,
        "searches": [SEARCH],
        "rate_per_min": 12.4,
        "eta_seconds": 82.0,
        "elapsed_seconds": 198.0,
        "cpu_seconds": 15.4,
    },
    MetricsView: {
        "campaign_id": 1,
        "by_strategy": [
            {
                "strategy": "S(0)",
                "n_solves": 28,
                "n_strict": 23,
                "strict_ratio": 0.821,
                "strict_ratio_low": 0.644,
            }
        ],
        "by_mapping": [],
        "seed_yields": [{"seed_k": None, "k": 0, "n_seeds": 0, "n_solves": 28, "n_strict": 23}],
        "seed_chains": [],
        "paired_changes": [],
    },
    RecordPage: {"items": [RECORD], "next": f"0x1.99da51eb851ecp+13_{SOLUTION}"},
    solution.PointsView: POINTS,
    solution.ClusterPage: {
        "items": [CLUSTER],
        "n_clusters": 85,
        "n": 706,
        "n_compared": 706,
        "threshold": 0.05,
    },
    solution.ChoicesView: CHOICES,
    solution.RecordInFull: RECORD
    | {"certificate_hash": None}
    | {"x": [71.3, 2.1, 4.0, 0.71], "verification": {"integrator": "DOP853", "tolerance": 1e-12}},
    solution.LineageGraph: {
        "id": SOLUTION,
        "nodes": [
            NODE | {"id": SOLUTION},
            NODE | {"id": SEED, "search": "s0", "strategy": "S(0)", "k": 0, "delta_v_km_s": 0.3196},
        ],
        "edges": [{"seed_id": SEED, "solution_id": SOLUTION, "mapping": "continued"}],
        "children": [],
        "n_children": 0,
        "n_mapped": 4,
        "command": f"coastarc solutions reproduce {SOLUTION}",
    },
    solution.Reproduction: {name: RECORD[name] for name in PROVENANCE}
    | {"id": SOLUTION, "problem_hash": ROBUST, "job": HOP_JOB, "hop": 0, "x": [71.3, 2.1, 4.0, 0.71]}
    | {"python_version": "3.11.7"},
    problem.ProblemFamily: {
        "n_solutions": 10,
        "best": [{name: RECORD[name] for name in problem.BestSolution.model_fields}],
        "fewer": [RELATIVE],
        "more": [],
        "n_fewer": 1,
        "n_more": 0,
    },
    problem.ProblemStructure: {
        "hash": ROBUST,
        "n_variables": 236,
        "n_defects": 14,
        "n_nonzeros": 2200,
        "n_dense": 2410,
        "trajectories": [SHAPE],
        "runs": [[0, 0, 154]],
        "filled_gap": 0,
        "departure_epoch": "2026-04-26T14:47:58.000",
        "departure_mass_kg": 13276.04,
        "between": {"scale_days": 227.89, "shape": 0.86737, "mean_days": 244.9, "median_days": 149.4},
        "recovery": {"scale_days": 2.459, "shape": 1.144, "mean_days": 2.34, "median_days": 1.78},
        "chances": [{"arc_days": 48.0, "none": 0.772, "one": 0.196, "several": 0.032}],
        "durations": [{"days": 1.5, "at_most": 0.433}],
    },
    SeedPage: {"items": [SEEDING], "n_candidates": 28, "is_cut": True},
    ProblemPage: {"items": [ITEM]},
    ProblemView: ITEM | {"definition": DEFINITION},
    JobPage: {"items": [JOB], "next": 17},
    JobView: JOB,
    WorkerPage: {"items": [WORKER]},
    EventPage: {"items": [EVENT | {"data": {"search": "s0", "search_id": 1, "state": "done"}}]},
    identity.TokenRequest: {"name": "ada", "role": "submitter", "days": 90.0},
    identity.TokenView: TOKEN,
    identity.NewToken: TOKEN | {"token": SIGNED_IN},
    identity.TokenPage: {"items": [TOKEN]},
    identity.SignIn: {"token": SIGNED_IN},
    identity.SessionView: {"name": "ada", "role": "submitter"},
    identity.AuditPage: {"items": [AUDIT], "next": 9},
    ClaimAnswer: {"claims": [HELD | {"job": HOP_JOB}], "lease_s": 30.0, "heartbeat_s": 10.0},
    HeartbeatAnswer: {"extended": [HELD], "to_cancel": [], "not_held": []},
    HandInAnswer: HELD | {"next_hop": 4},
    CompleteAnswer: HELD | {"state": "done"},
    CompleteManyAnswer: {"answers": [HELD | {"state": "done"}]},
}
_TRACK = {
    "inertial_km": [[-163000, 1200, 8]],
    "rotating_km": [[-161000, 900, 8]],
    "moon_km": [[384000, 0, 0]],
}
_ARC = {"kind": "thrust", "segment": 1, "first": 0, "stop": 40, "throttle": 1.0}
_FLOWN: dict[str, Any] = {
    "outage": None,
    "arcs": [_ARC | {"in_plane_rad": 0.12, "out_of_plane_rad": -0.01}],
    "matchpoint": 400,
    "days": [0.0],
    "speed_km_s": [1.02],
    "mass_kg": [13276.04],
}
#: What the trajectory of a solution looks like; its lists have hundreds of rows.
TRAJECTORY = {
    "trajectories": [_FLOWN | _TRACK],
    "moon": {"days": [0.0]} | _TRACK,
    "target": {"days": [0.0]} | _TRACK,
    "n_samples": 1,
}
