"""Departure and target of a problem, made before it or its campaign is stored.

A worker would find out as well that one of them cannot be, but only with one dead job after another.
"""

import time
from collections.abc import Callable

from core.ephemeris import EpochError, KernelError
from core.ephemeris.daf import SpkError
from core.orbits import SpiralError, departure_state, target_kernel
from core.orbits.clearance import ClearanceError, check_clearance
from core.orbits.halo import HaloError
from core.orbits.shooting import ShootingError
from core.problem import Problem, ProblemError, require_departure_mass, require_physical
from service.spec import SpecError

#: Why a problem whose fields are all in order cannot be flown.
IMPOSSIBLE = (
    EpochError,
    KernelError,
    SpkError,
    SpiralError,
    HaloError,
    ShootingError,
    ClearanceError,
    ProblemError,
    OSError,
)
#: Processor time for a spiral; one of 400 days from a low orbit takes 20 [s].
MOST_CPU_S = 30.0


def require_flyable(problem: Problem, name: str = "spec.problem") -> None:
    """Make what a problem starts from and flies to, or raise SpecError; all its outages share both."""
    try:
        require_physical(problem, name)
    except ProblemError as error:
        raise SpecError(str(error)) from error
    try:
        start = departure_state(problem.departure, problem.spacecraft, _after(MOST_CPU_S))
        require_departure_mass(problem, start.mass_kg)
        target_kernel(problem)
        check_clearance(problem)
    except IMPOSSIBLE as error:
        raise SpecError(f"{name}: {' '.join(str(error).split())}") from error


def _after(cpu_seconds: float) -> Callable[[], bool]:
    """Return whether this thread has used its processor time."""
    end = time.thread_time() + cpu_seconds
    return lambda: time.thread_time() > end
