"""The search: where guesses come from, and which outcome a chain goes on from."""

from core.search.alignment import REFINED, refined_problem
from core.search.guess_laws import GUESS_LAWS, sample_guess
from core.search.hopping import (
    HOP_LAWS,
    Chain,
    ChainState,
    HopAddress,
    HopLaw,
    HopSettings,
    Incumbent,
    draw_steps,
    hop,
    hop_rng,
    hop_times,
    is_better,
)
from core.search.mapping import MAPPINGS, check_mapping, expand_mapping, map_seed
from core.search.recovery import solve_recovery, solve_seed

__all__ = [
    "GUESS_LAWS",
    "HOP_LAWS",
    "MAPPINGS",
    "REFINED",
    "Chain",
    "ChainState",
    "HopAddress",
    "HopLaw",
    "HopSettings",
    "Incumbent",
    "check_mapping",
    "draw_steps",
    "expand_mapping",
    "hop",
    "hop_rng",
    "hop_times",
    "is_better",
    "map_seed",
    "refined_problem",
    "sample_guess",
    "solve_recovery",
    "solve_seed",
]
