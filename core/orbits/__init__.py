"""Where a transfer starts and ends: a departure and a target in, states, kernels and tables out.

`spiral` resolves the departure, `nrho` makes the near-rectilinear halo orbit, `target` hands it on.
"""

from core.orbits.spiral import DepartureState, SpiralError, departure_state
from core.orbits.target import target_kernel, target_table

__all__ = ["DepartureState", "SpiralError", "departure_state", "target_kernel", "target_table"]
