"""A decision vector as a table of named entries: written by us, or by anybody who wants to be compared."""

import csv
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core.problem import Problem
from core.transcription import layout_of
from service.api.vector_files import vector_lines
from service.benchmark.benchmark_set import BenchmarkError, read_text

Array = NDArray[np.float64]

#: What says which entry of the vector a row is.
PLACE = ("trajectory", "variable", "segment", "unit")


def read_vector(path: Path, problem: Problem) -> Array:
    """Return the vector of a file whose rows are the entries of a problem's vector, in order."""
    rows = _rows(read_text(path).splitlines())
    expected = _rows(
        "".join(vector_lines("", problem, np.zeros(layout_of(problem).n_variables))).splitlines()
    )
    if len(rows) != len(expected):
        raise BenchmarkError(f"{path}: expected {len(expected)} entries for P_{problem.k}, got {len(rows)}")
    return np.array(
        [
            _value(path, number, row, wanted)
            for number, (row, wanted) in enumerate(zip(rows, expected, strict=True))
        ]
    )


def _rows(lines: Iterable[str]) -> list[dict[str, str]]:
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def _value(path: Path, number: int, row: dict[str, str], wanted: dict[str, str]) -> float:
    place, expected = (tuple(one.get(name, "") for name in PLACE) for one in (row, wanted))
    if place != expected:
        said = " ".join(filter(None, expected))
        raise BenchmarkError(f"{path}: expected entry {number} to be {said}, got {' '.join(map(str, place))}")
    try:
        value = float(row.get("value") or "")
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise BenchmarkError(f"{path}: expected a number at entry {number}, got {row.get('value')}")
    return value
