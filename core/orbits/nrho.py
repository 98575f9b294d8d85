"""The near-rectilinear halo orbit: a CR3BP halo of a given period made ballistic in the N-body model.

The halo is found in the barycentric rotating frame, Earth at (-mu, 0, 0) and Moon at (1 - mu, 0, 0).  It is
the guess of a multiple shooting with free epochs and a minimum-norm Newton method: patch points hold an epoch
and a state; a piece between two of them is propagated half forwards from the first and half backwards from
the second, and its defect is the difference in the middle.
Frame elsewhere: geocentric, axes J2000, unless relative to the Moon.  Units: canonical, times in TU past the
origin of the force model.

    HaloError(RuntimeError)      a period without an orbit in reach
    ShootingError(RuntimeError)  a guess from which the correction does not converge
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from core.constants import MU_CR3BP
from core.dynamics import COAST, STATE, ForceModel, propagate
from core.ephemeris import EphemerisTable, state_at, states
from core.errors import UserError
from core.jit import compiled
from core.orbits.rotating import rotating_frame, to_inertial
from core.units import LU_KM, TU_DAYS, VU_KM_S

Array = NDArray[np.float64]

#: Bound on the residual of the symmetry conditions [LU, LU/TU]; rounding at perilune leaves 2e-13.
TOLERANCE = 5e-13

# An orbit of the family to start from: period; x, z and vy at apolune; docs/method.md, section 11.
_KNOWN_PERIOD = 1.5111964
_KNOWN_APOLUNE = np.array([1.0220279848, -0.1821012438, -0.1032704533])
# Perilune amplifies every change at apolune: Newton's method along the tangent converges over twice this.
_PERIOD_STEP = 0.05
_HALO_ITERATIONS = 12


class HaloError(UserError, RuntimeError):
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
        return _fly_halo(self.apolune, times)[:, :6]


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
    unknowns, tangent = _correct_halo(_KNOWN_APOLUNE, _KNOWN_PERIOD)
    goals = np.linspace(_KNOWN_PERIOD, period, n_steps + 1)
    for last, goal in itertools.pairwise(goals):
        unknowns, tangent = _correct_halo(unknowns + (goal - last) * tangent, goal)
    return Halo(period, _apolune_state(unknowns))


def _apolune_state(unknowns: Array) -> Array:
    x, z, vy = unknowns
    return np.array([x, 0.0, z, 0.0, vy, 0.0])


def _correct_halo(unknowns: Array, period: float) -> tuple[Array, Array]:
    """Solve for the x, z, vy at apolune that cross y = 0 at right angles half a period later.

    Their derivative by the period comes with them.
    """
    for _ in range(_HALO_ITERATIONS):
        end = _fly_halo(_apolune_state(unknowns), np.array([0.5 * period]))[0]
        residual = end[[1, 3, 5]]
        partials = end[6:].reshape(6, 6)[np.ix_([1, 3, 5], [0, 2, 4])]
        if np.abs(residual).max() < TOLERANCE:
            return unknowns, np.linalg.solve(partials, -0.5 * _rates(0.0, end)[[1, 3, 5]])
        unknowns = unknowns - np.linalg.solve(partials, residual)
    raise HaloError(
        f"halo: expected a symmetric orbit of period {period} TU, "
        f"got a residual of {np.abs(residual).max():.1e} after {_HALO_ITERATIONS} iterations"
    )


def _fly_halo(start: Array, times: Array) -> Array:
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


#: Bounds on the defects of a corrected trajectory.
POSITION_TOLERANCE_KM = 1e-6
VELOCITY_TOLERANCE_KM_S = 1e-9

# Tight, since a perilune amplifies the error of a step three hundred times.
_INTEGRATION_TOLERANCE = 1e-14
_MAX_ITERATIONS = 30


class ShootingError(UserError, RuntimeError):
    """A guess from which the correction does not converge."""


def correct(model: ForceModel, epochs: Array, states: Array) -> tuple[Array, Array]:
    """Return epochs and states of patch points near a guess whose pieces join.

    Parameters
    ----------
    model : ForceModel
        Gravity; its table must cover the epochs.
    epochs : (n,) array
        Ascending epochs [TU].
    states : (n, 6) array
        Position and velocity at them [LU, LU/TU].

    Raises
    ------
    ShootingError
        When the defects stay above their bounds.

    References
    ----------
    docs/method.md, eqs. (O6) and (O7).
    """
    unknowns = np.column_stack([epochs, states])
    for _ in range(_MAX_ITERATIONS):
        halves = fly_halves(model, unknowns[:, 0], unknowns[:, 1:])
        defects = halves[:, 0, :, 0] - halves[:, 1, :, 0]
        if _is_joined(defects):
            return unknowns[:, 0].copy(), unknowns[:, 1:].copy()
        if not np.isfinite(defects).all():
            break
        unknowns = unknowns - _smallest_step(_jacobian(halves), defects.ravel()).reshape(-1, 7)
    worst = np.abs(defects).max() * LU_KM
    raise ShootingError(f"shooting: expected defects below {POSITION_TOLERANCE_KM} km, got {worst:.1e} km")


def _is_joined(defects: Array) -> bool:
    position = np.linalg.norm(defects[:, :3], axis=1).max() * LU_KM
    velocity = np.linalg.norm(defects[:, 3:], axis=1).max() * VU_KM_S
    return bool(position < POSITION_TOLERANCE_KM and velocity < VELOCITY_TOLERANCE_KM_S)


def _smallest_step(jacobian: "scipy.sparse.csc_array", defects: Array) -> Array:
    """Return the least step s with jacobian s = defects, from the equations of its Lagrangian."""
    n = jacobian.shape[1]
    system = scipy.sparse.block_array(
        [[scipy.sparse.eye_array(n), jacobian.T], [jacobian, None]], format="csc"
    )
    return np.asarray(scipy.sparse.linalg.splu(system).solve(np.concatenate([np.zeros(n), defects]))[:n])


def _jacobian(halves: Array) -> "scipy.sparse.csc_array":
    """Return the partials of the defects, 6 a piece, by the epoch and the state of each patch point."""
    n_pieces = halves.shape[0]
    rates = halves[:, :, :, 7:]
    # The middle moves by half of each epoch, on both sides of the piece.
    by_middle = 0.5 * (rates[:, 0, :, 1] - rates[:, 1, :, 1])
    blocks = np.empty((n_pieces, 6, 14))
    for side, sign in ((0, 1.0), (1, -1.0)):
        transition = halves[:, side, :, 1:7]
        by_epoch = by_middle - sign * np.einsum("pij,pj->pi", transition, rates[:, side, :, 0])
        blocks[:, :, 7 * side] = by_epoch
        blocks[:, :, 7 * side + 1 : 7 * side + 7] = sign * transition
    rows = np.broadcast_to(np.arange(6 * n_pieces).reshape(-1, 6, 1), blocks.shape)
    columns = np.broadcast_to(7 * np.arange(n_pieces)[:, None, None] + np.arange(14), blocks.shape)
    shape = (6 * n_pieces, 7 * (n_pieces + 1))
    return scipy.sparse.csc_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=shape)


@compiled
def fly_halves(model: ForceModel, epochs: Array, states: Array) -> Array:
    """Return both halves (n - 1, 2, 6, 9) of every piece, NaN where one cannot be flown.

    Parameters
    ----------
    model : ForceModel
        Gravity.
    epochs, states : (n,) and (n, 6) arrays
        Patch points [TU; LU, LU/TU].

    Returns
    -------
    (n - 1, 2, 6, 9) array
        Per half the state in the middle, its partials by the state at the patch point (6 columns), and the
        rates of the state at the patch point and in the middle [canonical].
    """
    out = np.empty((epochs.size - 1, 2, 6, 9))
    ends, work = np.empty((2, 3)), np.empty((16, 3, COAST))
    for piece in range(epochs.size - 1):
        middle = 0.5 * (epochs[piece] + epochs[piece + 1])
        for side in range(2):
            start = states[piece + side]
            r, v = np.zeros((3, COAST)), np.zeros((3, COAST))
            for i in range(3):
                r[i, 0], v[i, 0] = start[i], start[3 + i]
                r[i, 1 + i] = v[i, 4 + i] = 1.0
            steps = coast(model, epochs[piece + side], middle, r, v, ends, work)
            half = out[piece, side]
            half[:3, :7], half[3:, :7] = r[:, :7], v[:, :7]
            half[:3, 7], half[:3, 8] = start[3:], v[:, 0]
            half[3:, 7], half[3:, 8] = ends[0], ends[1]
            if steps < 0:
                half[:] = np.nan
    return out


@compiled
def coast(model: ForceModel, t_a: float, t_b: float, r: Array, v: Array, ends: Array, work: Array) -> int:
    """Propagate without thrust in place; arguments and result are those of `core.dynamics.propagate`."""
    # Made here, since constant arrays would make numba compile the integrator once more for their own type.
    nothing, no_partials = np.zeros(3), np.zeros((3, 3))
    return propagate(
        model,
        t_a,
        t_b,
        1.0,
        nothing,
        0.0,
        no_partials,
        nothing,
        _INTEGRATION_TOLERANCE,
        r,
        v,
        ends,
        work,
    )


#: Revolutions solved beyond each end of the window: the end of a corrected orbit is held from one side only.
EXTRA_REVOLUTIONS = 3
#: Patch points a revolution: perilune, quarter, apolune, three quarters.
_PATCHES = 4


@dataclass(frozen=True, slots=True, eq=False)
class PatchedOrbit:
    """A ballistic orbit, given by states at most half a piece away."""

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
        return np.asarray(_propagate_patches(self.model, self.epochs, self.states, records))


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
def _propagate_patches(model: ForceModel, epochs: Array, patches: Array, records: Array) -> Array:
    """Return the states of `PatchedOrbit.states_from_moon`."""
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
    """Propagate from each time to the next, so that all together need a single pass."""
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
