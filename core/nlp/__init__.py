"""The local solver: a transcription and a guess in, an outcome with a named status out."""

from core.nlp.feasibility import outcome_of
from core.nlp.outcome import ExitStatus, Limits, Outcome, SolveSettings, Stop
from core.nlp.solve import limits_of, no_stop, solve

__all__ = [
    "ExitStatus",
    "Limits",
    "Outcome",
    "SolveSettings",
    "Stop",
    "limits_of",
    "no_stop",
    "outcome_of",
    "solve",
]
