"""The states and controls of a solution, and whether they follow from each other."""

import csv
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from spiceypy.utils.exceptions import SpiceyError

from core.constants import G0, SECONDS_PER_DAY
from core.ephemeris.kernels import furnish, one_at_a_time
from core.orbits import departure_state
from core.problem import Problem
from core.verification.repropagation import Pilot, Unflyable
from service.benchmark.benchmark_set import BenchmarkError, read_text

Array = NDArray[np.float64]

#: Samples per radian: a few in a segment, more where a trajectory turns quickly.
SAMPLES_PER_RADIAN = 2.0
#: How far the end of an arc may be from a flight that begins where it does: samples are for drawing and for
#: starting from, and are flown more coarsely than what is verified [km, km/s, kg].
POSITION_KM, VELOCITY_KM_S, MASS_KG = 0.1, 1e-4, 1e-6

STATE = ("x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s", "mass_kg")
CONTROL = ("throttle", "in_plane_rad", "out_of_plane_rad")
ARC = ("trajectory", "arc", "segment")


@dataclass(frozen=True, slots=True)
class Jumps:
    """How far the ends of arcs are from flights that begin where they do, at most."""

    n_arcs: int
    position_km: float
    velocity_km_s: float
    mass_kg: float

    @property
    def hold(self) -> bool:
        """Whether every arc ends where it should; not where a number is none."""
        within = zip(
            (self.position_km, self.velocity_km_s, self.mass_kg),
            (POSITION_KM, VELOCITY_KM_S, MASS_KG),
            strict=True,
        )
        return all(jump <= limit for jump, limit in within)


@one_at_a_time
def jumps(path: Path, problem: Problem) -> Jumps:
    """Fly from the first sample of every arc of a file to its last, by SciPy and SPICE alone."""
    furnish()
    departure = departure_state(problem.departure, problem.spacecraft)
    craft = problem.spacecraft
    pilot = Pilot(float(departure.et), craft.max_thrust_n, craft.isp_s * G0 * 1e-3)
    text = (line for line in read_text(path).splitlines() if not line.startswith("#"))
    try:
        arcs = [list(rows) for _, rows in groupby(csv.DictReader(text), key=_arc)]
        found = [_jump(pilot, rows[0], rows[-1]) for rows in arcs]
    except (KeyError, ValueError, TypeError) as error:
        raise BenchmarkError(f"{path}: expected columns of states and controls, got {error}") from error
    except (Unflyable, SpiceyError) as error:
        told = getattr(error, "short", None) or error
        raise BenchmarkError(f"{path}: expected arcs that can be flown, got one with {told}") from error
    if not found:
        raise BenchmarkError(f"{path}: expected samples of states and controls, got none")
    return Jumps(len(found), *(float(worst) for worst in np.max(np.abs(found), axis=0)))


def _arc(row: dict[str, str]) -> tuple[str, ...]:
    return tuple(row[name] for name in ARC)


def _jump(pilot: Pilot, row: dict[str, str], then: dict[str, str]) -> tuple[float, float, float]:
    start, stop = (float(one["days_past_departure"]) * SECONDS_PER_DAY for one in (row, then))
    state, there = (np.array([float(one[name]) for name in STATE]) for one in (row, then))
    control = np.array([float(row[name]) for name in CONTROL])
    off = pilot.arc(start, state, stop - start, pilot.thrust(control)) - there
    return float(np.linalg.norm(off[:3])), float(np.linalg.norm(off[3:6])), float(off[6])
