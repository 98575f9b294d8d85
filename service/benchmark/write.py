"""A set written from solutions: the same solutions give the same files, to the last digit."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from core.constants import KERNEL_MD5
from core.export import csv_lines, export_states
from core.orbits import target_kernel
from core.problem import problem_from
from service.api.vector_files import vector_lines
from service.benchmark.benchmark_set import (
    CERTIFICATE_FILE,
    CONSTANTS,
    NAME,
    PROBLEM_FILE,
    SET_FILE,
    STATES_FILE,
    TARGET_FILE,
    TOLERANCE,
    VECTOR_FILE,
    VERSION,
    BenchmarkError,
    BenchmarkSet,
    read_set,
    sha256,
)
from service.benchmark.check import problem_mass
from service.benchmark.states_file import SAMPLES_PER_RADIAN
from service.spec.spec_text import toml_text
from service.validation import solution_hash
from workers.certify import CertificateFile, certificate_of
from workers.measure_solves import Solution


def write_set(folder: Path, solutions: list[Solution], date: str) -> BenchmarkSet:
    """Write the set of one solution per problem, each of which has to be strict."""
    if folder.exists() and any(folder.iterdir()):
        raise BenchmarkError(f"benchmark: expected an empty folder, got {folder}; a set is never changed")
    if not solutions:
        raise BenchmarkError("solutions: expected at least one, got none")
    folder.mkdir(parents=True, exist_ok=True)
    kernel, naif_id = target_kernel(solutions[0].problem)
    shutil.copyfile(kernel, folder / TARGET_FILE)
    ordered = sorted(solutions, key=lambda one: one.problem.k)
    cases = [_write_case(folder, solution, naif_id) for solution in ordered]
    content = {
        "set": {"name": NAME, "version": VERSION, "date": date},
        "constants": CONSTANTS,
        "kernels": {"de440_md5": KERNEL_MD5, "target_sha256": sha256(folder / TARGET_FILE)},
        "tolerance": TOLERANCE,
        "case": cases,
    }
    (folder / SET_FILE).write_text(toml_text(content), encoding="utf-8")
    return read_set(folder)


def _write_case(folder: Path, solution: Solution, naif_id: int) -> dict[str, Any]:
    name = f"k{solution.problem.k}"
    if (folder / name).exists():
        raise BenchmarkError(f"solutions: expected one for each k, got two for k = {solution.problem.k}")
    fields = solution.problem.model_dump(mode="json")
    fields["target"] = {"kind": "spk", "path": TARGET_FILE, "naif_id": naif_id}
    problem = problem_from(fields | {"target": fields["target"] | {"path": str(folder / TARGET_FILE)}})
    x = np.array(solution.x)
    own = solution_hash(problem.hash, x)
    made = certificate_of(own, problem, x)
    if made.content.level != "strict" or not made.content.is_sound:
        raise BenchmarkError(f"solutions: expected strict ones, got one of P_{problem.k} that is not")
    (folder / name).mkdir()
    states = export_states(problem, x, SAMPLES_PER_RADIAN)
    texts = {
        PROBLEM_FILE: [toml_text({"problem": fields})],
        VECTOR_FILE: vector_lines(own, problem, x),
        STATES_FILE: csv_lines(states, (f"solution {own} of problem {problem.hash}",)),
        # When and where it was made would differ from one writing to the next.
        CERTIFICATE_FILE: [
            CertificateFile(content=made.content, hash=made.hash).model_dump_json(indent=1),
            "\n",
        ],
    }
    for file, lines in texts.items():
        (folder / name / file).write_text("".join(lines), encoding="utf-8")
    return {
        "name": name,
        "problem": problem.hash,
        "solution": own,
        "propellant_kg": problem_mass(problem) - made.content.trajectories[0].mass.stated_arrival,
        "sha256": {file: sha256(folder / name / file) for file in texts},
    }
