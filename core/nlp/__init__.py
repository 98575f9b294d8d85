"""The local solver: a transcription and a guess in, an outcome with a named status out."""

from core.nlp.judging import outcome_of
from core.nlp.limits import Limits, Stop
from core.nlp.outcome import ExitStatus, Outcome, SolveSettings
from core.nlp.solve import limits_of, never, solve

__all__ = [
    "ExitStatus",
    "Limits",
    "Outcome",
    "SolveSettings",
    "Stop",
    "limits_of",
    "never",
    "outcome_of",
    "solve",
]
