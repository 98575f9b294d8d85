"""Problems and points at which transcriptions are tested."""

from functools import cache

import numpy as np

from core.problem import load_problem
from core.transcription import transcribe

PRESET = load_problem("ppe-drm3")
#: Tight enough that two neighbouring points differ by their partials and not by their steps.
TIGHT = 1e-13
#: km, km/s, kg of the canonical units: LU 384,400 km, TU 375,190.25852 s, MU 15,000 kg.
UNITS = np.array([384400.0] * 3 + [384400.0 / 375190.25852] * 3 + [15000.0])


@cache
def problem(outages=(), n_segments=50, segmentation="adaptive"):
    fields = {"n_segments": n_segments, "segmentation": segmentation}
    return PRESET.model_copy(update=fields).with_outages(outages)


@cache
def transcription(outages=(), n_segments=50, segmentation="adaptive", n_legs=1, tolerance=TIGHT):
    return transcribe(problem(outages, n_segments, segmentation), n_legs, tolerance)


def random_point(transcribed, rng_seed):
    """Return a point of the box with times so short that partials stay below a hundred."""
    rng = np.random.default_rng(rng_seed)
    lower, upper = transcribed.bounds
    x = lower + (upper - lower) * rng.random(len(lower))
    for trajectory in transcribed.layout.trajectories:
        x[trajectory.shooting_time] = (0.15 + 0.2 * rng.random()) * upper[trajectory.shooting_time]
        x[trajectory.initial_coast] = 1.0 + 3.0 * rng.random()
        x[trajectory.final_coast] = 1.0 + 2.0 * rng.random()
        x[trajectory.final_mass] = 12500.0 + 700.0 * rng.random()
    return x
