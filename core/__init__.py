"""coastarc's numerics: from a problem to verified trajectories, without the service.

The names listed here are imported on first use, so that using one module of core does not import the others.
"""

from typing import TYPE_CHECKING

from core.lazy import on_demand

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

_HOMES = {
    "ExitStatus": "nlp.outcome",
    "Guess": "transcription",
    "Outcome": "nlp.outcome",
    "Problem": "problem",
    "ProblemError": "problem",
    "SolveSettings": "nlp.outcome",
    "Transcription": "transcription",
    "Verification": "verification.verify",
    "load_problem": "problem",
    "map_seed": "search",
    "problem_from": "problem",
    "sample_guess": "search",
    "solve": "nlp",
    "solve_recovery": "search",
    "solve_seed": "search",
    "target_kernel": "orbits",
    "transcribe": "transcription",
    "verify": "verification.verify",
}

__getattr__ = on_demand(__name__, _HOMES)


def __dir__() -> list[str]:
    # The reference of docs/ and completion at a prompt list what has not been asked for yet, too.
    return [*globals(), *__all__]
