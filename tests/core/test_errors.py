"""Which exceptions of core are a user's to mend."""

import pytest

from core.cache import CacheError
from core.ephemeris.daf import SpkError
from core.ephemeris.kernels import KernelError
from core.errors import UserError
from core.export.states import ExportError
from core.orbits.clearance import ClearanceError
from core.orbits.nrho import HaloError, ShootingError
from core.orbits.spiral import SpiralError
from core.problem import ProblemError

OF_USERS = [
    CacheError,
    ClearanceError,
    ExportError,
    HaloError,
    KernelError,
    ProblemError,
    ShootingError,
    SpiralError,
    SpkError,
]


@pytest.mark.parametrize("error", OF_USERS, ids=lambda error: error.__name__)
def test_what_a_problem_or_a_machine_can_cause_is_told_in_one_line_and_needs_no_traceback(error):
    assert issubclass(error, UserError)
    assert issubclass(error, ValueError | RuntimeError)
