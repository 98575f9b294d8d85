"""coastarc's numerics: a problem in, verified trajectories out; no service is needed to use them.

What is listed here is imported when it is asked for: whoever needs one module of core pays for no other.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from core.nlp import ExitStatus, Outcome, SolveSettings, solve
    from core.orbits import target_kernel
    from core.problem import Problem, ProblemError, load_problem, problem_from
    from core.search import map_seed, sample_guess, solve_recovery, solve_seed
    from core.transcription import Guess, Transcription, transcribe
    from core.verification.verify import Verification, verify

__all__ = [
    "ExitStatus",
    "Guess",
    "Outcome",
    "Problem",
    "ProblemError",
    "SolveSettings",
    "Transcription",
    "Verification",
    "load_problem",
    "map_seed",
    "problem_from",
    "sample_guess",
    "solve",
    "solve_recovery",
    "solve_seed",
    "target_kernel",
    "transcribe",
    "verify",
]

_MODULES = ("problem", "orbits", "transcription", "nlp", "search", "verification.verify")


def __getattr__(name: str) -> Any:
    if name in __all__:
        for module in _MODULES:
            found = import_module(f"core.{module}")
            if name in getattr(found, "__all__", vars(found)):
                return getattr(found, name)
    raise AttributeError(f"module 'core' has no attribute {name!r}")


def __dir__() -> list[str]:
    # The reference of docs/ and completion at a prompt list what has not been asked for yet, too.
    return [*globals(), *__all__]
