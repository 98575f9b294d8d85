"""The decision vector of a solution as a file, with names, units and bounds of its entries.

It begins with lines of `#` that say what it is; states and controls are written by `core.export`.
"""

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.csv_text import csv_text
from core.epochs import calendar_epoch
from core.export import trajectory_name
from core.orbits import departure_state
from core.problem import Problem
from core.transcription import Layout, TrajectoryLayout, layout_of

#: Lines that are sent at once.
BLOCK = 500
VECTOR_COLUMNS = ("index", "trajectory", "variable", "segment", "unit", "value", "lower", "upper")
CONTROLS = (("throttle", "-"), ("in_plane", "rad"), ("out_of_plane", "rad"))
_VECTOR = """\
# decision vector of solution {solution}
# problem {problem} with k = {k}; bounds are those of the problem
# units: days, throttle [-], rad, kg; time scale TDB; departure epoch {departure} TDB
"""


def vector_lines(solution_id: str, problem: Problem, x: NDArray[np.float64]) -> Iterator[str]:
    """Yield the head, then every entry of the vector with its bounds."""
    yield _head(solution_id, problem)
    yield from _blocks(VECTOR_COLUMNS, _entries(problem, x))


def _head(solution_id: str, problem: Problem) -> str:
    departure = calendar_epoch(_departure_et(problem))
    return _VECTOR.format(solution=solution_id, problem=problem.hash, k=problem.k, departure=departure)


def _departure_et(problem: Problem) -> float:
    return float(departure_state(problem.departure, problem.spacecraft).et)


def _blocks(columns: Iterable[str], rows: Iterator[Iterable[Any]]) -> Iterator[str]:
    block: list[Iterable[Any]] = [columns]
    while block:
        yield csv_text(block)
        block = list(islice(rows, BLOCK))


def _entries(problem: Problem, x: NDArray[np.float64]) -> Iterator[Iterable[Any]]:
    layout = layout_of(problem)
    start_mass = departure_state(problem.departure, problem.spacecraft).mass_kg
    # The box, as files of earlier versions have it: another dry mass does not change them.
    lower, upper = layout.sampling_box(problem, start_mass)
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
