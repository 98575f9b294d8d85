"""The search: where guesses come from, and which outcome a chain goes on from.

A name is imported when it is first asked for: whoever reads a specification needs `settings` alone, which is
light, while what flies arcs compiles them with numba.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from core.search.guess_laws import sample_guess
    from core.search.hopping import Chain, ChainState, Incumbent, hop, hop_times, is_better
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
        draw_steps,
        expand_mapping,
        hop_rng,
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

_HEAVY = {
    "sample_guess": "guess_laws",
    "Chain": "hopping",
    "ChainState": "hopping",
    "Incumbent": "hopping",
    "hop": "hopping",
    "hop_times": "hopping",
    "is_better": "hopping",
    "map_seed": "mapping",
    "solve_recovery": "recovery",
    "solve_seed": "recovery",
}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'core.search' has no attribute {name!r}")
    found = getattr(import_module(f"core.search.{_HEAVY.get(name, 'settings')}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return [*globals(), *__all__]
