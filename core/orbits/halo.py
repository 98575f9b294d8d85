"""Southern L2 halo orbits of the Earth-Moon CR3BP, found by their period.

Frame: barycentric, rotating, Earth at (-mu, 0, 0) and Moon at (1 - mu, 0, 0).  Units: canonical.

    HaloError(RuntimeError)   a period without an orbit in reach
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from core.constants import MU_CR3BP

Array = NDArray[np.float64]

#: Bound on the residual of the symmetry conditions [LU, LU/TU]; rounding at perilune leaves 2e-13.
TOLERANCE = 5e-13

# An orbit of the family to start from: period; x, z and vy at apolune; docs/method.md, section 11.
_KNOWN_PERIOD = 1.5111964
_KNOWN_APOLUNE = np.array([1.0220279848, -0.1821012438, -0.1032704533])
# Perilune magnifies every change at apolune: Newton along the tangent still converges over twice this.
_PERIOD_STEP = 0.05
_MAX_ITERATIONS = 12


class HaloError(RuntimeError):
    """A period for which the correction did not converge."""


@dataclass(frozen=True, slots=True, eq=False)
class Halo:
    """A halo orbit that crosses the plane y = 0 at right angles."""

    #: Period [TU].
    period: float
    #: (6,) state at apolune [LU, LU/TU].
    apolune: Array

    def states(self, times: Array) -> Array:
        """Return the states (n, 6) [LU, LU/TU] at ascending times (n,) in [0, period) after apolune [TU]."""
        return _flown(self.apolune, times)[:, :6]


def halo_of_period(period: float) -> Halo:
    """Return the halo orbit with a given period, by continuation along the family.

    Parameters
    ----------
    period : float
        Period [TU].

    Raises
    ------
    HaloError
        When the correction does not converge on the way.

    References
    ----------
    docs/method.md, eq. (O4).
    """
    n_steps = max(1, math.ceil(abs(period - _KNOWN_PERIOD) / _PERIOD_STEP))
    unknowns, tangent = _corrected(_KNOWN_APOLUNE, _KNOWN_PERIOD)
    goals = np.linspace(_KNOWN_PERIOD, period, n_steps + 1)
    for last, goal in itertools.pairwise(goals):
        unknowns, tangent = _corrected(unknowns + (goal - last) * tangent, goal)
    return Halo(period, _apolune_state(unknowns))


def jacobi_constant(state: Array) -> float:
    """Return the Jacobi constant [-] of a state (6,) [LU, LU/TU]."""
    x, y, z = state[:3]
    to_earth = math.hypot(x + MU_CR3BP, y, z)
    to_moon = math.hypot(x - 1.0 + MU_CR3BP, y, z)
    potential = 2.0 * (1.0 - MU_CR3BP) / to_earth + 2.0 * MU_CR3BP / to_moon
    return float(x * x + y * y + potential - state[3:] @ state[3:])


def _apolune_state(unknowns: Array) -> Array:
    x, z, vy = unknowns
    return np.array([x, 0.0, z, 0.0, vy, 0.0])


def _corrected(unknowns: Array, period: float) -> tuple[Array, Array]:
    """Solve for the x, z, vy at apolune that cross y = 0 at right angles half a period later.

    Their derivative by the period comes with them.
    """
    for _ in range(_MAX_ITERATIONS):
        end = _flown(_apolune_state(unknowns), np.array([0.5 * period]))[0]
        residual = end[[1, 3, 5]]
        partials = end[6:].reshape(6, 6)[np.ix_([1, 3, 5], [0, 2, 4])]
        if np.abs(residual).max() < TOLERANCE:
            return unknowns, np.linalg.solve(partials, -0.5 * _rates(0.0, end)[[1, 3, 5]])
        unknowns = unknowns - np.linalg.solve(partials, residual)
    raise HaloError(
        f"halo: expected a symmetric orbit of period {period} TU, "
        f"got a residual of {np.abs(residual).max():.1e} after {_MAX_ITERATIONS} iterations"
    )


def _flown(start: Array, times: Array) -> Array:
    """Return states and transition matrices (n, 42) at ascending times after a start (6,)."""
    y = np.concatenate([start, np.eye(6).ravel()])
    arc = scipy.integrate.solve_ivp(
        _rates, (0.0, times[-1]), y, method="DOP853", t_eval=times, rtol=3e-14, atol=1e-15
    )
    return np.asarray(arc.y.T)


def _rates(_: float, y: Array) -> Array:
    """Return the derivative of state and transition matrix (42,): docs/method.md, eq. (O4)."""
    place = y[:3]
    gradient = np.diag([1.0, 1.0, 0.0])
    pull = np.array([place[0], place[1], 0.0])
    for gm, x in ((1.0 - MU_CR3BP, -MU_CR3BP), (MU_CR3BP, 1.0 - MU_CR3BP)):
        away = place - [x, 0.0, 0.0]
        distance = math.sqrt(away @ away)
        pull -= gm / distance**3 * away
        gradient += gm / distance**3 * (3.0 * np.outer(away, away) / distance**2 - np.eye(3))
    # The Coriolis term.
    pull += [2.0 * y[4], -2.0 * y[3], 0.0]
    transition = y[6:].reshape(6, 6)
    turned = np.array([2.0 * transition[4], -2.0 * transition[3], np.zeros(6)])
    rates = np.vstack([transition[3:], gradient @ transition[:3] + turned])
    return np.concatenate([y[3:6], pull, rates.ravel()])
