"""The Jacobi constant of the circular restricted three-body problem."""

import math

from core.constants import MU_CR3BP


def jacobi_constant(state):
    """Return the Jacobi constant [-] of a state (6,) [LU, LU/TU]."""
    x, y, z = state[:3]
    to_earth = math.hypot(x + MU_CR3BP, y, z)
    to_moon = math.hypot(x - 1.0 + MU_CR3BP, y, z)
    potential = 2.0 * (1.0 - MU_CR3BP) / to_earth + 2.0 * MU_CR3BP / to_moon
    return x * x + y * y + potential - state[3:] @ state[3:]
