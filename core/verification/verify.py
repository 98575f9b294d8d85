"""Independent verification: re-propagate every trajectory with SciPy and SPICE, and check its defects.

Input: a problem and its decision vector x in public units.  Output: the defects (forward minus backward) of
the re-propagated trajectories, and whether they are within each of the two tolerances of docs/method.md.
No code is shared with `core.transcription` or `core.dynamics`, so that an error there cannot hide here.
"""

from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import NamedTuple

import numpy as np

from core.constants import SECONDS_PER_DAY
from core.ephemeris.kernels import check_kernels, furnish, kernel_hashes, loaded, one_at_a_time
from core.orbits import target_kernel
from core.plain_data import file_digest
from core.problem import Problem
from core.tolerances import Tolerance, violation
from core.verification.closest_approach import Approach, Closest
from core.verification.repropagation import (
    FINER_RTOL,
    INTEGRATOR,
    RTOL,
    Array,
    HalfTrajectories,
    Plan,
    departure_of,
    fly_all,
    pilot_of,
    plans_of,
)
from core.world import world_of

#: Between this fraction of a limit and its inverse, a defect may be within the limit at one tolerance of the
#: integrator and beyond it at another: the largest change observed was a fifth of a limit.
NEAR = 0.2

# The planetary kernel; epochs are TDB throughout, so the leap seconds play no part.
_PLANETS = "de440.bsp"

#: Fraction of a bound's width by which x may exceed it: IPOPT itself relaxes bounds by 1e-8.
BOUND_SLACK = 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class Verification:
    """The result of re-propagating one decision vector; trajectory 0 is the reference."""

    #: Forward minus backward state at the matchpoints (1 + k, 7) [km, km/s, kg], geocentric J2000.
    defects: Array
    #: Norms of the three parts of the defects, (1 + k,) each.
    position_km: Array
    velocity_km_s: Array
    mass_kg: Array
    #: Whether the defects are within the loose and the strict tolerance, and x within its bounds.
    paper: bool
    strict: bool
    #: Distance from the target at insertion, after coasting back from arrival (1 + k, 2) [km, km/s].
    target_error: Array
    #: Epoch of arrival (1 + k,) [TDB s past J2000].
    arrival_et: Array
    #: Mass at arrival (1 + k,) [kg].
    final_mass_kg: Array
    is_within_bounds: bool
    #: Whether the verdict differs with the integrator's tolerance; `paper` and `strict` hold at both.
    is_marginal: bool
    #: Closest approaches of each trajectory, to the Earth and to the Moon, as far as it was propagated.
    closest: tuple[tuple[Approach, ...], ...]
    #: Why a trajectory could not be propagated, empty if all were.
    failure: str
    integrator: str
    #: Relative tolerance of the integrator; of two, the one with the larger defects.
    tolerance: float
    #: Kernels used, as (name, hash).
    kernels: tuple[tuple[str, str], ...]
    n_evaluations: int


@one_at_a_time
def verify(problem: Problem, x: Array) -> Verification:
    """Re-propagate the reference and every realization of x, and compare the defects with the tolerances.

    A trajectory that cannot be propagated (it meets a body, or runs out of mass) has defects that are not
    finite, `strict` and `paper` are False, and `failure` says where it ended.

    Parameters
    ----------
    problem : Problem
        P_k.
    x : (n_variables,) array
        T_s, T_i, T_f [days], N times (throttle [-], in-plane, out-of-plane [rad]), m_f [kg] for the
        reference, then the same for each realization in the order of `problem.outages`.

    Returns
    -------
    Verification
        Defects [km, km/s, kg], their norms, and the verdict at both tolerances.

    Raises
    ------
    ValueError
        When x has another shape than the problem asks for, or is not finite.

    References
    ----------
    docs/method.md, "Verification".
    """
    plans, (kernel, naif_id) = plans_of(problem, x), load_target(problem)
    with loaded(world_of(problem).kernel):
        return verification_of(problem, plans, kernel, naif_id)


def load_target(problem: Problem) -> tuple[Path, int]:
    """Load every kernel of a problem into SPICE; return that of its target, and its NAIF id."""
    check_kernels()
    kernel, naif_id = target_kernel(problem)
    furnish(kernel)
    return kernel, naif_id


def verification_of(problem: Problem, plans: list[Plan], kernel: Path, naif_id: int) -> Verification:
    """Propagate in halves, twice where the integrator's tolerance may decide, and return the verdict."""
    found = [_propagate(problem, plans, naif_id, RTOL)]
    world = world_of(problem)
    if any(NEAR < violation(found[0].defects, level) < 1.0 / NEAR for level in (world.loose, world.strict)):
        found.append(_propagate(problem, plans, naif_id, FINER_RTOL))
    return _verdict(problem, plans, found, kernel)


class _Flight(NamedTuple):
    """All trajectories in halves, propagated at one tolerance."""

    rtol: float
    flights: list[HalfTrajectories]
    closest: tuple[tuple[Approach, ...], ...]
    n_evaluations: int

    @property
    def defects(self) -> Array:
        """Forward minus backward (1 + k, 7) [km, km/s, kg]."""
        return np.array([flown.forward[-1] - flown.backward[0] for flown in self.flights])


def _propagate(problem: Problem, plans: list[Plan], naif_id: int, rtol: float) -> _Flight:
    pilot = pilot_of(problem, rtol)
    watchers = [Closest(pilot) for _ in plans]
    flights = fly_all(pilot, problem, plans, naif_id, watchers)
    return _Flight(rtol, flights, tuple(one.approaches for one in watchers), pilot.n_evaluations)


def _verdict(problem: Problem, plans: list[Plan], found: list[_Flight], kernel: Path) -> Verification:
    """Return the verdict on one propagation, or what holds in both of two."""
    world = world_of(problem)
    first, worst = found[0], max(found, key=lambda flight: violation(flight.defects, world.strict))
    norms, is_within_bounds = _norms(worst.defects), _is_within_bounds(problem, plans)
    levels = {
        tuple(holds(flight.defects, level) for level in (world.loose, world.strict)) for flight in found
    }
    paper, strict = (is_within_bounds and all(level) for level in zip(*levels, strict=True))
    return Verification(
        defects=worst.defects,
        position_km=norms[:, 0],
        velocity_km_s=norms[:, 1],
        mass_kg=norms[:, 2],
        paper=paper,
        strict=strict,
        target_error=np.array([flown.target_error for flown in first.flights]),
        arrival_et=departure_of(problem)[0] + np.array([flown.arrival for flown in first.flights]),
        final_mass_kg=np.array([plan.final_mass for plan in plans]),
        is_within_bounds=is_within_bounds,
        is_marginal=is_within_bounds and len(levels) > 1,
        closest=first.closest,
        failure="; ".join(_failures(worst.flights)),
        integrator=INTEGRATOR,
        tolerance=worst.rtol,
        kernels=(
            (_PLANETS, kernel_hashes()[_PLANETS]),
            *((path.name, file_digest(path)) for path in (kernel, world.kernel) if path is not None),
        ),
        n_evaluations=sum(flight.n_evaluations for flight in found),
    )


def holds(defects: Array, tolerance: Tolerance) -> bool:
    """Return whether defects (n, 7) [km, km/s, kg] are finite and within a tolerance, norm by norm."""
    # A comparison with NaN is False, so defects that are not finite never hold.
    limits = (tolerance.position_km, tolerance.velocity_km_s, tolerance.mass_kg)
    return bool(np.all(_norms(defects) <= np.array(limits)))


def _norms(defects: Array) -> Array:
    position = np.linalg.norm(defects[:, 0:3], axis=1)
    velocity = np.linalg.norm(defects[:, 3:6], axis=1)
    return np.stack([position, velocity, np.abs(defects[:, 6])], axis=1)


def _is_within_bounds(problem: Problem, plans: list[Plan]) -> bool:
    n = problem.n_segments
    shares = [1.0, *((n - outage.segment) / n for outage in problem.outages)]
    return all(_plan_is_within(problem, *pair) for pair in zip(plans, shares, strict=True))


def _plan_is_within(problem: Problem, plan: Plan, share: float) -> bool:
    bounds = problem.bounds
    low, high = bounds.shooting_days
    start_mass = float(departure_of(problem)[1][6])
    return all(
        (
            # Only the upper bound certainly shrinks for a realization; the lower one is taken at its least.
            _is_between(plan.shooting / SECONDS_PER_DAY, low * share, high * share),
            _is_between(plan.initial_coast / SECONDS_PER_DAY, *bounds.initial_coast_days),
            _is_between(plan.final_coast / SECONDS_PER_DAY, *bounds.final_coast_days),
            _is_between(plan.controls[:, 0], *bounds.throttle),
            _is_between(plan.controls[:, 1], -pi, pi),
            _is_between(plan.controls[:, 2], -pi / 2, pi / 2),
            _is_between(plan.final_mass, problem.least_final_mass_kg, start_mass),
        )
    )


def _is_between(values: Array | float, low: float, high: float) -> bool:
    slack = BOUND_SLACK * (high - low)
    return bool(np.all((values >= low - slack) & (values <= high + slack)))


def _failures(flights: list[HalfTrajectories]) -> list[str]:
    names = ["reference", *(f"realization {i}" for i in range(1, len(flights)))]
    return [f"{name} {flown.failure}" for name, flown in zip(names, flights, strict=True) if flown.failure]
