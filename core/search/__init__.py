"""The search: guess and hop distributions, mappings of seeds, and monotonic basin hopping.

A name is imported on first use: reading a specification needs `settings` alone, which is light, while the
modules that propagate arcs import numba.
"""

from typing import TYPE_CHECKING

from core.lazy import on_demand

if TYPE_CHECKING:
    from core.search.hopping import (
        Chain,
        ChainState,
        Incumbent,
        draw_steps,
        hop,
        hop_rng,
        hop_times,
        is_better,
        sample_guess,
    )
    from core.search.mapping import map_seed
    from core.search.recovery import solve_recovery, solve_seed
    from core.search.settings import (
        GUESS_LAWS,
        HOP_LAWS,
        MAPPINGS,
        REFINED,
        HopAddress,
        HopLaw,
        HopSettings,
        check_mapping,
        expand_mapping,
        refined_problem,
    )

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

_HOMES = {
    "GUESS_LAWS": "settings",
    "HOP_LAWS": "settings",
    "MAPPINGS": "settings",
    "REFINED": "settings",
    "Chain": "hopping",
    "ChainState": "hopping",
    "HopAddress": "settings",
    "HopLaw": "settings",
    "HopSettings": "settings",
    "Incumbent": "hopping",
    "check_mapping": "settings",
    "draw_steps": "hopping",
    "expand_mapping": "settings",
    "hop": "hopping",
    "hop_rng": "hopping",
    "hop_times": "hopping",
    "is_better": "hopping",
    "map_seed": "mapping",
    "refined_problem": "settings",
    "sample_guess": "hopping",
    "solve_recovery": "recovery",
    "solve_seed": "recovery",
}

__getattr__ = on_demand(__name__, _HOMES)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
