"""coastarc's numerics: a problem in, verified trajectories out; no service is needed to use them."""

from core.analysis.verify import Verification, verify
from core.nlp import ExitStatus, Outcome, SolveSettings, solve
from core.orbits import target_kernel
from core.problem import Problem, ProblemError, load_problem, problem_from
from core.search import map_seed, sample_guess, solve_recovery, solve_seed
from core.transcription import Guess, Transcription, transcribe

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
