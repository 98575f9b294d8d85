"""Whether a set is what it says: its files, its constants, and every solution flown again from them alone."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from core.ephemeris.kernels import kernel_hashes
from core.orbits import departure_state
from core.problem import Problem
from core.tolerances import STRICT, violation
from service.benchmark.benchmark_set import (
    CERTIFICATE_FILE,
    CONSTANTS,
    STATES_FILE,
    TARGET_FILE,
    TOLERANCE,
    VECTOR_FILE,
    BenchmarkError,
    BenchmarkSet,
    Case,
    sha256,
)
from service.benchmark.certificate import differences, largest_miss_km, read_certificate
from service.benchmark.states_file import jumps
from service.benchmark.vector_file import read_vector
from service.schemas.answer import Check
from service.validation import solution_hash
from workers.certify import CertificateContent, certificate_of

#: What the propellant of a table may be rounded by [kg].
PROPELLANT_KG = 1e-6


def check_set(benchmark: BenchmarkSet, names: tuple[str, ...] = ()) -> Iterator[Check]:
    """Yield every check of a set, or of some of its cases, as it is made."""
    cases = [benchmark.case(name) for name in names] or benchmark.cases
    yield _same("constants", benchmark.constants, CONSTANTS)
    yield _same("tolerance", benchmark.tolerance, TOLERANCE)
    yield _same("de440.bsp", benchmark.de440_md5, kernel_hashes()["de440.bsp"])
    target = _same(TARGET_FILE, benchmark.target_sha256, sha256(benchmark.folder / TARGET_FILE))
    yield target
    if target.state == "failed":
        # Nothing can be flown to another target, and perhaps it cannot even be read.
        return
    for case in cases:
        yield from _check_case(case)


def _check_case(case: Case) -> Iterator[Check]:
    digests = {name: sha256(case.folder / name) for name in case.files}
    yield _same(f"{case.name} files", case.files, digests)
    try:
        problem = case.problem()
        yield _same(f"{case.name} problem", case.problem_hash, problem.hash)
        x = read_vector(case.folder / VECTOR_FILE, problem)
        yield _same(f"{case.name} solution", case.solution, solution_hash(problem.hash, x))
        stated = read_certificate(case.folder / CERTIFICATE_FILE)
        limit_km = None if stated.min_altitudes_km else stated.min_altitude_km
        found = certificate_of(case.solution, problem, x, limit_km).content
        yield _flight(case, found)
        yield _made(f"{case.name} certificate", differences(stated, found), "says what this flight finds")
        yield _propellant(case, problem_mass(problem) - found.trajectories[0].mass.stated_arrival)
        yield _states(case, problem)
    except BenchmarkError as error:
        yield _made(case.name, [str(error)], "")


def problem_mass(problem: Problem) -> float:
    """Return the mass at departure [kg]."""
    return float(departure_state(problem.departure, problem.spacecraft).mass_kg)


def _flight(case: Case, found: CertificateContent) -> Check:
    defects = np.array([flown.defect for flown in found.trajectories], dtype=np.float64)
    told = (
        f"worst defect {100 * violation(defects, STRICT):.1f} % of the tolerance, arrives within "
        f"{largest_miss_km(found):.3g} km uncorrected, {found.integrator.name}"
    )
    is_good = found.level == "strict" and found.is_sound
    return _made(f"{case.name} flight", [] if is_good else [found.failure, *found.marks, told], told)


def _propellant(case: Case, propellant_kg: float) -> Check:
    is_off = not abs(propellant_kg - case.propellant_kg) <= PROPELLANT_KG
    told = f"{propellant_kg:.6f} kg"
    return _made(f"{case.name} propellant", [f"{told}, {case.propellant_kg} stated"] if is_off else [], told)


def _states(case: Case, problem: Problem) -> Check:
    found = jumps(case.folder / STATES_FILE, problem)
    told = f"{found.n_arcs} arcs end within {1e3 * found.position_km:.0f} m, {found.velocity_km_s:.0e} km/s"
    return _made(f"{case.name} states", [] if found.hold else [told], told)


def _same(name: str, stated: Any, found: Any) -> Check:
    if isinstance(stated, dict):
        keys = sorted(stated.keys() | found.keys())
        faults = [
            f"{key}: {stated.get(key)} stated, {found.get(key)} found"
            for key in keys
            if stated.get(key) != found.get(key)
        ]
        return _made(name, faults, f"{len(keys)} as stated")
    return _made(name, [] if stated == found else [f"{stated} stated, {found} found"], str(found)[:16])


def _made(name: str, faults: list[str], found: str) -> Check:
    advice = "fetch the set again, or report what differs" if faults else ""
    return Check(
        name=name,
        state="failed" if faults else "ok",
        found="; ".join(filter(None, faults)) or found,
        advice=advice,
    )
