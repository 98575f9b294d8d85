"""Facts of made-up solves, each with what its test is about."""

from dataclasses import replace

import numpy as np

from core.analysis.campaign_facts import CampaignFacts, SolveFacts
from core.problem import load_problem

PROBLEM = load_problem("ppe-drm3")
FAILED = SolveFacts(
    search="S(0)",
    seeds_from=None,
    strategy="S(0)",
    k=0,
    seed_k=None,
    seed_level=None,
    outages=(),
    mapping=None,
    chain="0" * 32,
    hop=0,
    status="LOCALLY_INFEASIBLE",
    paper=False,
    strict=False,
    cpu_seconds=10.0,
    cap_seconds=60.0,
    seed_id=None,
    solution_id=None,
    propellant_kg=None,
    delta_v_km_s=None,
    delta_v_total_km_s=None,
    time_of_flight_days=None,
)


def failed(segments=(), days=1.0, seeds_from=None, seed_k=None, **changes):
    """Return a solve of the case that found nothing."""
    k = len(segments)
    strategy = f"S({k})" if seeds_from is None else f"S({k}|{seed_k})"
    return replace(
        FAILED,
        **{
            "search": strategy,
            "strategy": strategy,
            "k": k,
            "outages": tuple((segment, days) for segment in segments),
            "seeds_from": seeds_from,
            "seed_k": seed_k,
            "seed_level": None if seeds_from is None else "strict",
            "mapping": None if seeds_from is None else "reference",
            **changes,
        },
    )


def solved(name, propellant_kg=300.0, *segments, is_strict=True, **changes):
    """Return a solve of the case that found a solution; 500 kg are 1 km/s here, and the spiral takes 3."""
    return failed(
        segments,
        **{
            "status": "OPTIMAL",
            "paper": True,
            "strict": is_strict,
            "solution_id": name,
            "propellant_kg": propellant_kg,
            "delta_v_km_s": propellant_kg / 500.0,
            "delta_v_total_km_s": 3.0 + propellant_kg / 500.0,
            "time_of_flight_days": 45.0,
            **changes,
        },
    )


def campaign(*solves, shooting_days=None):
    """Return the facts of a campaign; solutions thrust never, for so many days, or 40."""
    vectors = {}
    for solve in solves:
        if solve.solution_id is not None:
            x = np.zeros(154 * (1 + solve.k))
            x[0] = (shooting_days or {}).get(solve.solution_id, 40.0)
            vectors[solve.solution_id] = x
    return CampaignFacts(1, "made up", "active", 7, PROBLEM, solves, vectors)
