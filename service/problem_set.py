"""The open benchmark: a folder of problems with solutions to beat, written, checked and compared with others.

    set.toml          name, version, constants, kernels, tolerances; a table [[case]] for each problem
    target.bsp        the target orbit, the same for all cases
    CASE/problem.toml, vector.csv, states.csv, certificate.json

Whatever a check needs is in the folder, but for DE440, whose digest is.  A check verifies every solution from
these files alone; the same solutions give the same files, to the last digit.

    BenchmarkError(ValueError)   a folder or a file that is not what it should be
"""

import csv
import hashlib
import math
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from spiceypy.utils.exceptions import SpiceyError

from core import plain_data
from core.constants import (
    G0,
    GM_EARTH,
    GM_JUPITER,
    GM_MOON,
    GM_SUN,
    KERNEL_MD5,
    RADIUS_EARTH_KM,
    RADIUS_MOON_KM,
    SECONDS_PER_DAY,
)
from core.ephemeris.kernels import furnish, kernel_hashes, one_at_a_time
from core.errors import UserError, fault_lines
from core.export import csv_lines, export_states
from core.orbits import departure_state, target_kernel
from core.plain_data import MOST_FILE_BYTES, content_hash
from core.plain_data import read_toml as tables_in
from core.problem import Problem, ProblemError, problem_from
from core.tolerances import STRICT, violation
from core.transcription import layout_of
from core.verification.repropagation import Pilot, UnflyableError
from core.verification.verify import verify
from service.api.vector_files import vector_lines
from service.schemas.answer import Answer, Check
from service.spec.spec_text import toml_text
from service.validation import solution_hash
from workers.certificate import CertificateContent, CertificateFile
from workers.certify import certificate_of
from workers.measure_solves import Solution

Array = NDArray[np.float64]

SET_FILE, TARGET_FILE = "set.toml", "target.bsp"
PROBLEM_FILE, VECTOR_FILE, STATES_FILE, CERTIFICATE_FILE = (
    "problem.toml",
    "vector.csv",
    "states.csv",
    "certificate.json",
)

#: What the set of this version is called, and where it is beside the sources.
NAME, VERSION = "coastarc robust set", "2026.1"
FOLDER = Path(__file__).resolve().parents[1] / "benchmark" / f"robust-set-{VERSION}"

CONSTANTS = {
    "gm_earth_km3_s2": GM_EARTH,
    "gm_moon_km3_s2": GM_MOON,
    "gm_sun_km3_s2": GM_SUN,
    "gm_jupiter_km3_s2": GM_JUPITER,
    "g0_m_s2": G0,
    "radius_earth_km": RADIUS_EARTH_KM,
    "radius_moon_km": RADIUS_MOON_KM,
}
TOLERANCE = {
    "position_km": STRICT.position_km,
    "velocity_km_s": STRICT.velocity_km_s,
    "mass_kg": STRICT.mass_kg,
}


class BenchmarkError(UserError, ValueError):
    """A folder or a file of a benchmark that is not what it should be."""


@dataclass(frozen=True, slots=True)
class Case:
    """One problem of a set; what stands in it was written down, not found out."""

    name: str
    folder: Path
    problem_hash: str
    solution: str
    propellant_kg: float
    #: SHA-256 of the files of the case, by name.
    files: dict[str, str]

    def problem(self) -> Problem:
        """Return P_k, with the target of this very folder."""
        path = self.folder / PROBLEM_FILE
        try:
            fields = read_toml(path)["problem"]
            fields["target"]["path"] = str(self.folder.parent / fields["target"]["path"])
            return problem_from(fields)
        except (KeyError, TypeError, ProblemError) as error:
            told = f"no {error}" if isinstance(error, KeyError) else str(error)
            raise BenchmarkError(f"{path}: expected a problem, got {told}") from error


@dataclass(frozen=True, slots=True)
class BenchmarkSet:
    """What `set.toml` says."""

    folder: Path
    name: str
    version: str
    constants: dict[str, float]
    #: Digests of the kernels: MD5 of DE440, as NAIF publishes it, and SHA-256 of the target.
    de440_md5: str
    target_sha256: str
    tolerance: dict[str, float]
    cases: tuple[Case, ...]

    def case(self, name: str) -> Case:
        """Return the case of a name."""
        for case in self.cases:
            if case.name == name:
                return case
        names = ", ".join(case.name for case in self.cases)
        raise BenchmarkError(f"case: expected one of {names}, got {name}")


def read_set(folder: Path) -> BenchmarkSet:
    """Return the set in a folder; nothing but its table of contents is read."""
    if not (folder / SET_FILE).is_file():
        raise BenchmarkError(
            f"benchmark: expected a folder with {SET_FILE}, got {folder}; "
            "name the one in a clone of the repository, benchmark/..."
        )
    content = read_toml(folder / SET_FILE)
    try:
        return BenchmarkSet(
            folder=folder,
            name=content["set"]["name"],
            version=content["set"]["version"],
            constants=dict(content["constants"]),
            de440_md5=content["kernels"]["de440_md5"],
            target_sha256=content["kernels"]["target_sha256"],
            tolerance=dict(content["tolerance"]),
            cases=tuple(_case(folder, entry) for entry in content["case"]),
        )
    except (KeyError, TypeError, ValueError) as error:
        told = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise BenchmarkError(f"{folder / SET_FILE}: expected the table of a benchmark, got {told}") from error


def _case(folder: Path, entry: dict[str, Any]) -> Case:
    return Case(
        name=entry["name"],
        folder=folder / entry["name"],
        problem_hash=entry["problem"],
        solution=entry["solution"],
        propellant_kg=float(entry["propellant_kg"]),
        files=dict(entry["sha256"]),
    )


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a file."""
    try:
        return tables_in(read_text(path), MOST_FILE_BYTES)
    except ValueError as error:
        raise BenchmarkError(f"{path}: expected TOML, got {error}") from error


def read_text(path: Path) -> str:
    """Return the text of a file."""
    try:
        return plain_data.read_text(path)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise BenchmarkError(f"{path}: expected a file to read, got {reason}") from error


def sha256(path: Path) -> str:
    """Return the digest of a file that `sha256sum` prints, or nothing where there is none."""
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


#: A flight on another machine rounds otherwise; the masses of the vector do not.
CERTIFIED_MASS_KG = 1e-9
#: Fields of the content that every machine finds.
SAME = ("problem_hash", "solution_id", "k", "level", "is_sound", "failure")


def read_certificate(path: Path) -> CertificateContent:
    """Return the content of a certificate that has the hash it names."""
    try:
        found = CertificateFile.model_validate_json(read_text(path))
    except ValidationError as error:
        (first, *_) = fault_lines(str(path), error.errors(include_url=False), CertificateFile)
        raise BenchmarkError(first) from error
    if content_hash(found.content.model_dump(mode="json")) != found.hash:
        raise BenchmarkError(f"{path}: expected the hash of its content, got {found.hash}")
    return found.content


def differences(stated: CertificateContent, found: CertificateContent) -> list[str]:
    """Return in what a certificate contradicts another flight of the same solution."""
    pairs = [(name, getattr(stated, name), getattr(found, name)) for name in SAME]
    pairs.append(("arrival_epoch", _arrivals(stated), _arrivals(found)))
    faults = [f"{name}: {ours} stated, {theirs} found" for name, ours, theirs in pairs if ours != theirs]
    ours, theirs = _masses(stated), _masses(found)
    if len(ours) != len(theirs) or not np.allclose(ours, theirs, rtol=0.0, atol=CERTIFIED_MASS_KG):
        faults.append(f"stated_arrival: {ours} stated, {theirs} found")
    return faults


def largest_miss_km(content: CertificateContent) -> float:
    """Return the largest miss at arrival [km], infinite where a trajectory was not flown so far."""
    misses = [flown.through.arrival_miss[0] for flown in content.trajectories]
    return max(math.inf if miss is None else miss for miss in misses)


def _arrivals(content: CertificateContent) -> list[str]:
    return [flown.arrival_epoch for flown in content.trajectories]


def _masses(content: CertificateContent) -> list[float]:
    return [flown.mass.stated_arrival for flown in content.trajectories]


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
    except (UnflyableError, SpiceyError) as error:
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
        yield _check(f"{case.name} certificate", differences(stated, found), "says what this flight finds")
        yield _propellant(case, problem_mass(problem) - found.trajectories[0].mass.stated_arrival)
        yield _states(case, problem)
    except BenchmarkError as error:
        yield _check(case.name, [str(error)], "")


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
    return _check(f"{case.name} flight", [] if is_good else [found.failure, *found.marks, told], told)


def _propellant(case: Case, propellant_kg: float) -> Check:
    is_off = not abs(propellant_kg - case.propellant_kg) <= PROPELLANT_KG
    told = f"{propellant_kg:.6f} kg"
    return _check(f"{case.name} propellant", [f"{told}, {case.propellant_kg} stated"] if is_off else [], told)


def _states(case: Case, problem: Problem) -> Check:
    found = jumps(case.folder / STATES_FILE, problem)
    told = f"{found.n_arcs} arcs end within {1e3 * found.position_km:.0f} m, {found.velocity_km_s:.0e} km/s"
    return _check(f"{case.name} states", [] if found.hold else [told], told)


def _same(name: str, stated: Any, found: Any) -> Check:
    if isinstance(stated, dict):
        keys = sorted(stated.keys() | found.keys())
        faults = [
            f"{key}: {stated.get(key)} stated, {found.get(key)} found"
            for key in keys
            if stated.get(key) != found.get(key)
        ]
        return _check(name, faults, f"{len(keys)} as stated")
    return _check(name, [] if stated == found else [f"{stated} stated, {found} found"], str(found)[:16])


def _check(name: str, faults: list[str], found: str) -> Check:
    advice = "fetch the set again, or report what differs" if faults else ""
    return Check(
        name=name,
        state="failed" if faults else "ok",
        found="; ".join(filter(None, faults)) or found,
        advice=advice,
    )


class Judgement(Answer):
    """What an independent flight says of a vector, and how it compares."""

    case: str
    solution: str
    #: Whether it counts: every defect and every bound holds at the strict tolerance.
    is_strict: bool
    #: Why not, where a trajectory could not be flown.
    failure: str
    #: The largest defect over its tolerance.
    violation: float
    propellant_kg: float
    best_known_kg: float
    #: Propellant beyond that of the solution of the set; negative is better.
    excess_kg: float


def judge(case: Case, path: Path) -> Judgement:
    """Fly the vector in a file and compare."""
    problem = case.problem()
    x = read_vector(path, problem)
    solution = solution_hash(problem.hash, x)
    found = verify(problem, x)
    propellant = problem_mass(problem) - float(found.final_mass_kg[0])
    return Judgement(
        case=case.name,
        solution=solution,
        is_strict=found.strict,
        failure=found.failure,
        violation=violation(found.defects, STRICT),
        propellant_kg=propellant,
        best_known_kg=case.propellant_kg,
        excess_kg=propellant - case.propellant_kg,
    )


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
