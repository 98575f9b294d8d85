"""A start vector for the solver, with the states of its trajectories where a mapping knows them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Guess:
    """A decision vector; the states, if any, start the shooting nodes and are never part of the solution."""

    #: (n_variables,) in the paper layout [days, rad, kg].
    x: Array
    #: (N_w + 1, 7) states at the segment boundaries of each trajectory [LU, VU, MU]; None, or NaN for a
    #: boundary: propagate x.
    states: tuple[Array | None, ...] | None = None

    def __len__(self) -> int:
        """Return the length of x."""
        return len(self.x)

    def __getitem__(self, index: Any) -> Any:
        """Return entries of x."""
        return self.x[index]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """Return x, so that a guess can stand wherever a decision vector can."""
        return np.array(self.x, dtype=dtype, copy=copy)
