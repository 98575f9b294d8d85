"""How far apart two flights of one decision vector may end, on any processor."""

import numpy as np

#: Steps of one arc, at most: arcs last days, and a step near the Moon takes hours.
STEPS = 10


def apart(transcribed, x, tolerance):
    """Return what two flights of x, whose steps end at different places, may differ by in their defects.

    Each step errs by a share `tolerance` of the state. The path magnifies this, as it does a change of the
    times and controls by the same share, which the Jacobian tells: (n_defects,) km, km/s, kg.
    """
    n_arcs = sum(trajectory.n_segments + 3 for trajectory in transcribed.layout.trajectories)
    return n_arcs * STEPS * tolerance * (abs(transcribed.jacobian(x)) @ np.abs(x))
