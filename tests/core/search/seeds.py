"""A seed of P_1: a known solution whose realization has a recovery of its own."""

import json
from pathlib import Path

import numpy as np

from tests.core.transcription.points import problem

_VECTORS = Path(__file__).parents[2] / "acceptance" / "vectors.json"
#: Its problem: an outage of a day at segment 24, after which it coasts for ten days more.
ONE = problem(((24, 1.0),))


def robust_solution():
    """Return the decision vector of a solution of `ONE`, closed to metres."""
    return np.array(json.loads(_VECTORS.read_text(encoding="utf-8"))["S(1|0)"][0])
