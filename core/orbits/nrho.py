"""The near-rectilinear halo orbit: a CR3BP halo made ballistic in the N-body model.

Frame: geocentric, axes J2000, unless relative to the Moon.  Units: canonical, times in TU past the origin
of the force model.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.constants import MU_CR3BP
from core.dynamics import STATE, ForceModel
from core.ephemeris import EphemerisTable, state_at, states
from core.jit import compiled
from core.orbits.halo import Halo, halo_of_period
from core.orbits.rotating import rotating_frame, to_inertial
from core.orbits.shooting import coast, correct
from core.units import TU_DAYS

Array = NDArray[np.float64]

#: Revolutions solved beyond each end of the window: the end of a corrected orbit is held from one side only.
EXTRA_REVOLUTIONS = 3
#: Patch points a revolution: perilune, quarter, apolune, three quarters.
_PATCHES = 4


@dataclass(frozen=True, slots=True, eq=False)
class PatchedOrbit:
    """A ballistic orbit, held by states that are half a piece away at most."""

    #: Gravity under which it is ballistic.
    model: ForceModel
    #: (n,) epochs [TU].
    epochs: Array
    #: (n, 6) geocentric states [LU, LU/TU].
    states: Array

    def states_from_moon(self, records: Array) -> Array:
        """Return states relative to the Moon (n, m, 6) [LU, LU/TU] at ascending epochs (n, m) [TU].

        Each row is flown from one patch point, the one nearest to its middle, so that the defects of the
        orbit, small as they are, lie between rows and not inside.
        """
        return np.asarray(_flown(self.model, self.epochs, self.states, records))


def nrho(
    model: ForceModel, period_days: float, perilune_days: float, window: tuple[float, float]
) -> PatchedOrbit:
    """Return the ballistic orbit that follows a halo orbit of the CR3BP over a window.

    Parameters
    ----------
    model : ForceModel
        Gravity; its table must reach `margin_days` beyond the window.
    period_days : float
        Period of the halo orbit [days].
    perilune_days : float
        Epoch near which one perilune falls, and the others at multiples of the period [days past the origin].
    window : (float, float)
        First and last epoch [days past the origin].

    Raises
    ------
    HaloError, ShootingError
        When there is no halo orbit of this period, or no ballistic orbit near it.

    References
    ----------
    docs/method.md, eqs. (O5) to (O7).
    """
    halo = halo_of_period(period_days / TU_DAYS)
    first = math.floor((window[0] - perilune_days) / period_days) - EXTRA_REVOLUTIONS
    last = math.ceil((window[1] - perilune_days) / period_days) + EXTRA_REVOLUTIONS
    quarters = np.arange(_PATCHES * first, _PATCHES * last + 1)
    epochs = (perilune_days + quarters * period_days / _PATCHES) / TU_DAYS
    return PatchedOrbit(model, *correct(model, epochs, _guess(halo, model.bodies, epochs, quarters)))


def margin_days(period_days: float) -> float:
    """Return how far the force model must reach beyond the window [days], for a period [days]."""
    # The window may begin anywhere in a revolution, and corrected epochs move by a fraction of a day.
    return (EXTRA_REVOLUTIONS + 1.5) * period_days


def _guess(halo: Halo, bodies: EphemerisTable, epochs: Array, quarters: NDArray[np.int_]) -> Array:
    """Return geocentric states (n, 6) at epochs where the halo is that many quarters past a perilune."""
    of_phase = halo.states(np.linspace(0.0, halo.period, _PATCHES, endpoint=False))
    moon_in_halo = np.array([1.0 - MU_CR3BP, 0.0, 0.0])
    guess = np.empty((epochs.size, 6))
    for state, epoch, quarter in zip(guess, epochs, quarters, strict=True):
        # The halo counts its phases from apolune, two quarters before perilune.
        phase = of_phase[(quarter + 2) % _PATCHES]
        moon = state_at(bodies, epoch * TU_DAYS)[:, :3]
        frame = rotating_frame(moon)
        # Kepler's third law: everything is slower while the Moon is far.
        rate = phase[3:] * frame.distance**-1.5
        position, velocity = to_inertial(frame, phase[:3] - moon_in_halo, rate)
        state[:3], state[3:] = moon[0] + position, moon[1] + velocity
    return guess


@compiled
def _flown(model: ForceModel, epochs: Array, patches: Array, records: Array) -> Array:
    """Return what `PatchedOrbit.states_from_moon` promises."""
    out = np.empty((*records.shape, 6))
    middles = 0.5 * (records[:, 0] + records[:, -1])
    for n in range(epochs.size):
        first = np.searchsorted(middles, 0.5 * (epochs[max(n - 1, 0)] + epochs[n]))
        here = np.searchsorted(middles, epochs[n])
        last = np.searchsorted(middles, 0.5 * (epochs[n] + epochs[min(n + 1, epochs.size - 1)]))
        _fly_on(model, epochs[n], patches[n], records[here:last].ravel(), out[here:last])
        _fly_on(model, epochs[n], patches[n], records[first:here].ravel()[::-1], out[first:here][::-1, ::-1])
    return out


@compiled
def _fly_on(model: ForceModel, t: float, state: Array, times: Array, out: Array) -> None:
    """Fly from one of the times to the next, so that all together cost one passage."""
    ends, work = np.empty((2, 3)), np.empty((16, 3, STATE))
    bodies = np.empty((3, 9))
    r, v = state[:3].copy().reshape(3, 1), state[3:].copy().reshape(3, 1)
    for n in range(times.size):
        steps = coast(model, t, times[n], r, v, ends, work)
        t = times[n]
        states(model.bodies, t, bodies)
        place = out[n // out.shape[1], n % out.shape[1]]
        place[:3], place[3:] = r[:, 0] - bodies[0, :3], v[:, 0] - bodies[1, :3]
        if steps < 0:
            place[:] = np.nan
