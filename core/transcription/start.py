"""Where a transfer begins that is already under way, instead of at the departure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.problem import Problem

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """A state on the way, and the problem that it is on the way of."""

    #: Its bodies, its target and its departure epoch stay; its bounds, segments and outages play no part.
    problem: Problem
    #: When the transfer begins [TU past departure].
    time: float
    #: (7,) state there [LU, VU, MU].
    state: Array
