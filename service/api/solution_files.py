"""A solution as a file: its states and controls sample by sample, or its decision vector with its bounds.

Both begin with lines of `#` that say what it is: problem, frame, units, time scale.  The states are those of
the pictures, flown again by the integrator of the solver; a proof is `core.analysis.verify`.
"""

import csv
import io
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.analysis.flight import Arc, Flight, FlownTrajectory
from core.constants import SECONDS_PER_DAY
from core.orbits import departure_state
from core.problem import Problem, calendar_epoch
from core.transcription import Layout, TrajectoryLayout, layout_of
from workers.certificate import trajectory_name

#: Lines that are sent at once.
BLOCK = 500
STATE_COLUMNS = (
    "trajectory",
    "outage_segment",
    "outage_days",
    "arc",
    "segment",
    "epoch_tdb",
    "days_past_departure",
    *("x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s", "mass_kg"),
    *("throttle", "in_plane_rad", "out_of_plane_rad"),
    *("moon_x_km", "moon_y_km", "moon_z_km"),
)
VECTOR_COLUMNS = ("index", "trajectory", "variable", "segment", "unit", "value", "lower", "upper")
CONTROLS = (("throttle", "-"), ("in_plane", "rad"), ("out_of_plane", "rad"))
_STATES = """\
# states and controls of solution {solution}
# problem {problem} with k = {k}: the reference; then a realization per outage, from the outage on
# frame: origin Earth, axes J2000 (ICRF); the Moon in the same frame
# units: km, km/s, kg, rad, days; time scale TDB; departure epoch {departure} TDB
# angles: azimuth in the xy-plane and elevation above it; a sample where two arcs meet stands in both
"""
_VECTOR = """\
# decision vector of solution {solution}
# problem {problem} with k = {k}; bounds are those of the problem
# units: days, throttle [-], rad, kg; time scale TDB; departure epoch {departure} TDB
"""


def state_lines(solution_id: str, problem: Problem, flight: Flight) -> Iterator[str]:
    """Yield the head, then every sample of every trajectory in order of time."""
    yield _head(_STATES, solution_id, problem)
    yield from _blocks(STATE_COLUMNS, _states(problem, flight))


def vector_lines(solution_id: str, problem: Problem, x: NDArray[np.float64]) -> Iterator[str]:
    """Yield the head, then every entry of the vector with its bounds."""
    yield _head(_VECTOR, solution_id, problem)
    yield from _blocks(VECTOR_COLUMNS, _entries(problem, x))


def _head(text: str, solution_id: str, problem: Problem) -> str:
    departure = calendar_epoch(_departure_et(problem))
    return text.format(solution=solution_id, problem=problem.hash, k=problem.k, departure=departure)


def _departure_et(problem: Problem) -> float:
    return float(departure_state(problem.departure, problem.spacecraft).et)


def _blocks(columns: Iterable[str], rows: Iterator[Iterable[Any]]) -> Iterator[str]:
    block: list[Iterable[Any]] = [columns]
    while block:
        written = io.StringIO()
        csv.writer(written, lineterminator="\n").writerows(block)
        yield written.getvalue()
        block = list(islice(rows, BLOCK))


def _states(problem: Problem, flight: Flight) -> Iterator[Iterable[Any]]:
    departure = _departure_et(problem)
    for index, flown in enumerate(flight.trajectories):
        missed = (flown.outage.segment, flown.outage.duration_days) if flown.outage else ("", "")
        for arc in flown.arcs:
            for i in range(arc.first, arc.stop):
                yield (trajectory_name(index), *missed, *_sample(flown, arc, i, departure))


def _sample(flown: FlownTrajectory, arc: Arc, i: int, departure: float) -> Iterable[Any]:
    days = float(flown.days[i])
    state = (*flown.inertial_km[i].tolist(), *flown.velocity_km_s[i].tolist(), float(flown.mass_kg[i]))
    control = (arc.throttle, arc.in_plane_rad, arc.out_of_plane_rad)
    epoch = calendar_epoch(departure + days * SECONDS_PER_DAY)
    return (arc.kind, arc.segment or "", epoch, days, *state, *control, *flown.moon_km[i].tolist())


def _entries(problem: Problem, x: NDArray[np.float64]) -> Iterator[Iterable[Any]]:
    layout = layout_of(problem)
    start_mass = departure_state(problem.departure, problem.spacecraft).mass_kg
    lower, upper = layout.bounds(problem, start_mass)
    for index, (name, segment, unit, trajectory) in enumerate(_variables(layout)):
        numbers = (float(values[index]) for values in (x, lower, upper))
        yield (index, trajectory, name, segment, unit, *numbers)


def _variables(layout: Layout) -> Iterator[tuple[str, int | str, str, str]]:
    """Yield name, segment, unit and trajectory of each entry of x."""
    for index, own in enumerate(layout.trajectories):
        named: dict[int, tuple[str, int | str, str]] = {
            own.shooting_time: ("shooting_time", "", "d"),
            own.initial_coast: ("initial_coast", "", "d"),
            own.final_coast: ("final_coast", "", "d"),
            own.final_mass: ("final_mass", "", "kg"),
        } | _controls(own)
        for place in sorted(named):
            yield (*named[place], trajectory_name(index))


def _controls(own: TrajectoryLayout) -> dict[int, tuple[str, int | str, str]]:
    return {
        own.control(segment) + part: (name, segment, unit)
        for segment in range(1, own.n_segments + 1)
        for part, (name, unit) in enumerate(CONTROLS)
    }
