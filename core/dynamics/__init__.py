"""Dynamics of the spacecraft: the force model, and states with partials at the end of an arc."""

from core.dynamics.dop853 import (
    COAST,
    NOT_FINITE,
    STATE,
    THRUST,
    TOO_MANY_STEPS,
    integrate,
    no_trail,
    propagate,
)
from core.dynamics.force import ForceModel, fall, force_model

__all__ = [
    "COAST",
    "NOT_FINITE",
    "STATE",
    "THRUST",
    "TOO_MANY_STEPS",
    "ForceModel",
    "fall",
    "force_model",
    "integrate",
    "no_trail",
    "propagate",
]
