"""The local solver: a transcription and a guess in, an outcome with a named status out."""

from core.nlp.limits import Limits, Stop
from core.nlp.outcome import ExitStatus, Outcome, SolveSettings
from core.nlp.solve import close_defects, limits_of, never, optimize, outcome_of, solve

__all__ = [
    "ExitStatus",
    "Limits",
    "Outcome",
    "SolveSettings",
    "Stop",
    "close_defects",
    "limits_of",
    "never",
    "optimize",
    "outcome_of",
    "solve",
]
