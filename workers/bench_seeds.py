"""Files of solutions that one benchmark saves and another takes as seeds, and which of them are distinct."""

import json
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from core.analysis.similarity import DISTINCT, clusters, distance, feature_rows
from core.plain_data import read_text
from core.problem import Problem, problem_from
from core.transcription import checked_vector, layout_of

__all__ = [
    "DISTINCT",
    "Solution",
    "distance",
    "distinct",
    "read_solutions",
    "write_json",
    "write_solutions",
]


@dataclass(frozen=True, slots=True)
class Solution:
    """A strict solution and its problem."""

    #: Its number in the run that found it.
    number: int
    problem: Problem
    #: In the paper layout [days, rad, kg].
    x: tuple[float, ...]
    #: Propellant of the reference [kg].
    propellant_kg: float
    is_optimal: bool


def write_json(path: Path, content: Any) -> None:
    """Replace a file by a whole new one, so that whoever reads it or kills us finds no half of it."""
    beside = path.with_name(path.name + ".new")
    beside.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    os.replace(beside, path)


def write_solutions(path: Path, problem: Problem, solutions: Iterable[Solution]) -> None:
    """Save solutions of problems of one family."""
    listed = [
        {
            "number": one.number,
            "outages": [[outage.segment, outage.duration_days] for outage in one.problem.outages],
            "propellant_kg": one.propellant_kg,
            "is_optimal": one.is_optimal,
            "x": one.x,
        }
        for one in solutions
    ]
    without = problem.model_copy(update={"outages": ()})
    write_json(path, {"problem": without.model_dump(mode="json"), "solutions": listed})


def read_solutions(path: Path) -> list[Solution]:
    """Return saved solutions, or raise ValueError naming the file, what was expected and what came."""
    try:
        content = json.loads(read_text(path))
        problem = problem_from(content["problem"])
        return [_solution(problem, entry) for entry in content["solutions"]]
    except OSError as error:
        raise ValueError(f"seeds: expected a file that can be read, got {path}: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        told = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise ValueError(f"seeds: expected what `bench solve --save` writes, got {path}: {told}") from error


def _solution(problem: Problem, entry: dict[str, Any]) -> Solution:
    case = problem.with_outages([(segment, days) for segment, days in entry["outages"]])
    x = tuple(checked_vector(layout_of(case), entry["x"]).tolist())
    return Solution(int(entry["number"]), case, x, float(entry["propellant_kg"]), bool(entry["is_optimal"]))


def distinct(solutions: Iterable[Solution]) -> list[Solution]:
    """Return the solutions of one family that are farther than `DISTINCT` from every one kept before them."""
    listed = list(solutions)
    if not listed:
        return []
    found = clusters(feature_rows(listed[0].problem, [np.asarray(one.x) for one in listed]), DISTINCT)
    return [listed[i] for i in np.unique(found, return_index=True)[1]]
