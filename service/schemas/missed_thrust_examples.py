"""An example of a missed-thrust analysis."""

from typing import Any

from pydantic import BaseModel

from service.schemas.examples import SOLUTION
from service.schemas.solution import MissedThrustPage

RISK = {
    "segment": 24,
    "start_days": 41.7,
    "throttle": 1.0,
    "longest_days": 1.0,
    "is_open": False,
    "lost_probability": 0.0021,
    "is_fragile": True,
}
VIEW = {
    "solution_id": SOLUTION,
    "k": 1,
    "campaign_id": 7,
    "campaign_state": "done",
    "n_done": 4,
    "n_jobs": 4,
    "cpu_seconds": 12.6,
    "final_mass_kg": 13047.6,
    "arrival_days": 66.3,
    "throttles": [0.0, 1.0],
    "durations_days": [0.5, 1.0, 1.5],
    "segments": [RISK],
    "propellant_kg": [[0.4, 1.9, None]],
    "delay_days": [[0.2, 0.7, None]],
    "is_tried": [[True, True, True]],
    "fragile": [24],
    "survivability": {
        "arc_days": 66.9,
        "none": 0.71,
        "one": 0.23,
        "several": 0.06,
        "recovered_given_one_least": 0.82,
        "recovered_given_one_most": 0.91,
        "survived_least": 0.9,
        "survived_most": 0.92,
    },
}
EXAMPLES: dict[type[BaseModel], dict[str, Any]] = {MissedThrustPage: {"items": [VIEW]}}
