"""The search: where guesses come from, and which outcome a chain goes on from."""

from core.search.addresses import HopAddress, hop_rng
from core.search.assignments import MAPPINGS, check_mapping, expand_mapping
from core.search.continuation import solve_seed
from core.search.guess_laws import GUESS_LAWS, sample_guess
from core.search.hop_laws import HOP_LAWS, HopLaw, draw_steps
from core.search.hopping import Chain, ChainState, HopSettings, Incumbent, hop, hop_times, is_better
from core.search.mapping import map_seed
from core.search.recovery import solve_recovery
from core.search.refinement import REFINED, refined_problem

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
