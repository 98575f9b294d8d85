"""Starts close to a known solution of the preset, from which a solve takes a fraction of a second."""

import json
from pathlib import Path

import numpy as np

_VECTORS = Path(__file__).parents[1] / "acceptance" / "vectors.json"
_OPTIMUM = Path(__file__).parent / "analysis" / "optimum.json"


def solution():
    """Return the decision vector of a transfer of 90 days under control, closed to metres."""
    return np.array(json.loads(_VECTORS.read_text(encoding="utf-8"))["S(0)"][1])


def near(transcribed, rng_seed, width=1e-3):
    """Return the known solution moved by up to a share of each range, inside the bounds."""
    lower, upper = transcribed.bounds
    step = 2.0 * np.random.default_rng(rng_seed).random(len(lower)) - 1.0
    return np.clip(solution() + width * (upper - lower) * step, lower, upper)


def optimum():
    """Return a local optimum that SciPy's SLSQP stalled at, closed to metres."""
    return np.array(json.loads(_OPTIMUM.read_text(encoding="utf-8")))
