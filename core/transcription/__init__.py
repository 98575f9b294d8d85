"""Transcription of a problem into an NLP: from a decision vector to defects and partials."""

from core.transcription.arcs import FlownPath, RealizationPath, ReferencePath, fly_arc, target_state
from core.transcription.control import control_of, throttle_of, wrapped
from core.transcription.layout import STATE, Guess, Layout, Start, TrajectoryLayout, checked_vector, layout_of
from core.transcription.plan import OutageProfile, Structure
from core.transcription.transcription import (
    DEFAULT_LEGS,
    FINE_TOLERANCE,
    TOLERANCE,
    Transcription,
    transcribe,
)

__all__ = [
    "DEFAULT_LEGS",
    "FINE_TOLERANCE",
    "STATE",
    "TOLERANCE",
    "FlownPath",
    "Guess",
    "Layout",
    "OutageProfile",
    "RealizationPath",
    "ReferencePath",
    "Start",
    "Structure",
    "TrajectoryLayout",
    "Transcription",
    "checked_vector",
    "control_of",
    "fly_arc",
    "layout_of",
    "target_state",
    "throttle_of",
    "transcribe",
    "wrapped",
]
