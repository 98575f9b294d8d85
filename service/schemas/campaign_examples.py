"""What answers about campaigns as the dashboard shows them, and about specifications, look like."""

from typing import Any

from pydantic import BaseModel

from service.schemas import campaign, problem
from service.schemas.examples import CAMPAIGN, SOLUTION

_RATIO = {"value": 0.91, "low": 0.62, "high": 0.98}
#: What a campaign looks like in a list, and how it came to what it has found.
CARD = CAMPAIGN | {
    "outcomes": {"strict": 36, "paper": 1, "infeasible": 4, "timeout": 0, "numerical": 0},
    "n_guesses_planned": 58,
    "n_searches": 2,
    "strategies": ["S(0)", "S(1|0)"],
    "rate_per_min": 12.4,
    "eta_seconds": 82.0,
    "elapsed_seconds": 198.0,
    "cpu_seconds": 402.1,
    "sparkline_km_s": [None, 0.3412, 0.3196],
    "n_read": 41,
}
HISTORY: dict[str, Any] = {
    "campaign_id": 1,
    "n_solves": 41,
    "n_read": 41,
    "outcomes": {
        "width_seconds": 5,
        "strict": [0, 4, 7],
        "paper": [0, 0, 1],
        "infeasible": [1, 2, 1],
        "timeout": [0, 0, 0],
        "numerical": [0, 0, 0],
    },
    "strategies": [
        {
            "strategy": "S(1|0)",
            "k": 1,
            "seed_k": 0,
            "n_solves": 11,
            "n_paper": 11,
            "n_strict": 10,
            "paper_ratio": {"value": 1.0, "low": 0.74, "high": 1.0},
            "strict_ratio": _RATIO,
            "core_hours": 0.0043,
            "steps": [{"core_hours": 0.0004, "delta_v_km_s": 0.3235, "solution_id": SOLUTION}],
        }
    ],
    "chains": [
        {
            "seed_k": 0,
            "k": 1,
            "n_seeds": 11,
            "n_solves": 11,
            "n_strict": 10,
            "strict_ratio": _RATIO,
            "core_seconds_per_strict": 1.54,
        }
    ],
    "delta_v": [
        {
            "strategy": "S(1|0)",
            "k": 1,
            "duration_days": 1.0,
            "n_solutions": 10,
            "least_km_s": 0.3235,
            "lower_quartile_km_s": 0.3301,
            "median_km_s": 0.3342,
            "upper_quartile_km_s": 0.3377,
            "greatest_km_s": 0.3519,
            "sample_km_s": [0.3235, 0.3342, 0.3519],
        }
    ],
}
SPEC = {"campaign": {"name": "quick", "rng_seed": 2026}, "problem": {"preset": "ppe-drm3"}, "search": []}
SPEC_PLAN = {
    "name": "quick",
    "rng_seed": 2026,
    "n_segments": 50,
    "searches": [
        {
            "id": "s0",
            "strategy": "S(0)",
            "n_cases": 1,
            "n_guesses_most": 30,
            "core_hours_most": 1.0,
            "seeds_from": None,
        }
    ],
    "n_cases": 1,
    "n_guesses_most": 30,
    "core_hours_most": 1.0,
}
SPEC_TEXT = {"name": "quick", "toml": '[campaign]\nname = "quick"\nrng_seed = 2026\n'}
TAKEN_IN = {
    "campaign_id": 2,
    "new_campaigns": ["study", "study, robust"],
    "n_solves": 812,
    "n_solutions": 706,
    "n_certificates": 12,
}

EXAMPLES: dict[type[BaseModel], dict[str, Any]] = {
    campaign.CampaignCards: {"items": [CARD]},
    campaign.HistoryView: HISTORY,
    campaign.TakenInView: TAKEN_IN,
    problem.SpecCheck: {"faults": [], "fields": SPEC, "plan": SPEC_PLAN},
    problem.SpecText: SPEC_TEXT,
    problem.SpecTemplates: {"items": [SPEC_TEXT]},
}
