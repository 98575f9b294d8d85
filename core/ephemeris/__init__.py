"""Ephemerides: from SPICE kernels to Chebyshev tables for the compiled numerics.

`kernels` loads DE440, `tables` fits and evaluates, `spk` writes and reads spacecraft orbits.
"""

from core.ephemeris.kernels import KernelError, check_kernels, furnish, kernel_hashes, one_at_a_time
from core.ephemeris.tables import (
    EphemerisTable,
    EpochError,
    body_table,
    coefficients_through,
    jerks,
    positions,
    span_days,
    state_at,
    states,
    values_at_nodes,
)

__all__ = [
    "EphemerisTable",
    "EpochError",
    "KernelError",
    "body_table",
    "check_kernels",
    "coefficients_through",
    "furnish",
    "jerks",
    "kernel_hashes",
    "one_at_a_time",
    "positions",
    "span_days",
    "state_at",
    "states",
    "values_at_nodes",
]
