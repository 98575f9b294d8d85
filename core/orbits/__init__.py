"""Departure and target of a transfer: from their definitions to states, kernels and tables.

`spiral` resolves the departure, `nrho` makes the near-rectilinear halo orbit, `target` hands it on.
"""

from core.orbits.spiral import DepartureState, SpiralError, departure_state
from core.orbits.target import target_kernel, target_table

__all__ = ["DepartureState", "SpiralError", "departure_state", "target_kernel", "target_table"]
