"""Reproduces a solution: runs its job on this machine and compares the vectors bit by bit."""

import math
from collections.abc import Callable

import numpy as np

from service.schemas.answer import Answer
from service.schemas.solution import Reproduction
from service.validation import solution_hash
from workers.messages import Job, JobOutcome, Provenance, SolveRecord


class Difference(Answer):
    """Something that was not the same when the solution was found."""

    what: str
    then: str
    now: str


class Comparison(Answer):
    """What a second run of a job gave."""

    id: str
    #: Whether every bit of the vector is the same.
    is_same: bool
    #: Hash of what was found now; None if it is no solution.
    found_id: str | None
    #: How the solve ended, now and then.
    status: str | None
    status_then: str
    cpu_seconds: float
    cpu_seconds_then: float
    n_variables: int
    #: Entries of the vector that differ, and the largest difference, in parts of the larger of 1 and them.
    n_different: int | None
    largest_difference: float | None
    #: What differs between that run and this one besides.
    differences: list[Difference]


def reproduce(wanted: Reproduction, runner: Callable[[Job], JobOutcome]) -> Comparison:
    """Run the job of a solution and compare; what the job could not finish counts as different."""
    outcome = runner(wanted.job)
    record = next((solve for solve in outcome.solves if solve.hop == wanted.hop), None)
    found = record.x if record else None
    n_different, largest = _compare(np.array(wanted.x), found)
    return Comparison(
        id=wanted.id,
        is_same=n_different == 0,
        found_id=None if found is None else solution_hash(wanted.problem_hash, found),
        status=_status(record, outcome),
        status_then=wanted.status,
        cpu_seconds=record.cpu_seconds if record else 0.0,
        cpu_seconds_then=wanted.cpu_seconds,
        n_variables=len(wanted.x),
        n_different=n_different,
        largest_difference=largest,
        differences=_differences(wanted, outcome.provenance) if outcome.provenance else [],
    )


def _compare(then: np.ndarray, found: tuple[float, ...] | None) -> tuple[int | None, float | None]:
    if found is None:
        return None, None
    now = np.array(found)
    # By bits: -0.0 is another one than 0.0.
    n_different = int(np.count_nonzero(then.view(np.uint64) != now.view(np.uint64)))
    return n_different, float(np.max(np.abs(now - then) / np.maximum(np.abs(then), 1.0), initial=0.0))


def _status(record: SolveRecord | None, outcome: JobOutcome) -> str | None:
    if record is not None:
        return record.status
    return outcome.error.strip().splitlines()[-1] if outcome.error else outcome.ending.value


def _differences(then: Reproduction, now: Provenance) -> list[Difference]:
    pairs = [
        ("code", then.code_version, now.code_version),
        ("Python", then.python_version, now.python_version),
        ("host", then.host, now.host),
    ]
    for title, old, new in (
        ("package", then.package_versions, now.package_versions),
        ("kernel", then.kernel_hashes, now.kernel_hashes),
    ):
        names = sorted(old.keys() | new.keys())
        pairs.extend((f"{title} {name}", old.get(name, "-"), new.get(name, "-")) for name in names)
    return [Difference(what=what, then=old, now=new) for what, old, new in pairs if old != new]


def verdict(comparison: Comparison) -> str:
    """Return what came out in one sentence."""
    if comparison.is_same:
        return f"The same vector: all {comparison.n_variables} numbers agree in every bit."
    if comparison.n_different is None:
        return (
            f"No solution this time: the solve ended with {comparison.status}, then {comparison.status_then}."
        )
    assert comparison.largest_difference is not None and math.isfinite(comparison.largest_difference)
    return (
        f"Another vector: {comparison.n_different} of {comparison.n_variables} numbers differ, "
        f"by up to {comparison.largest_difference:.2g} of the larger of 1 and the number."
    )
