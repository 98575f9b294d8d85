"""Departure and target of a problem, made before it or its campaign is stored.

A worker would find out as well that one of them cannot be, but only with one dead job after another.
"""

from core.ephemeris import EpochError, KernelError
from core.ephemeris.daf import SpkError
from core.orbits import SpiralError, departure_state, target_kernel
from core.orbits.halo import HaloError
from core.orbits.shooting import ShootingError
from core.problem import Problem
from service.spec import SpecError

#: Why a problem whose fields are all in order cannot be flown.
IMPOSSIBLE = (EpochError, KernelError, SpkError, SpiralError, HaloError, ShootingError, OSError)


def require_flyable(problem: Problem, name: str = "spec.problem") -> None:
    """Make what a problem starts from and flies to, or raise SpecError; all its outages share both."""
    try:
        departure_state(problem.departure, problem.spacecraft)
        target_kernel(problem)
    except IMPOSSIBLE as error:
        raise SpecError(f"{name}: {' '.join(str(error).split())}") from error
