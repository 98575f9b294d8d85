"""A set of problems with solutions to beat, as it stands in a folder.

    set.toml          name, version, constants, kernels, tolerances; a table [[case]] for each problem
    target.bsp        the target orbit, the same for all cases
    CASE/problem.toml, vector.csv, states.csv, certificate.json

Whatever a check needs is in the folder, but for DE440, whose digest is.

    BenchmarkError(ValueError)   a folder or a file that is not what it should be
"""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from core import plain_data
from core.constants import G0, GM_EARTH, GM_JUPITER, GM_MOON, GM_SUN, RADIUS_EARTH_KM, RADIUS_MOON_KM
from core.errors import UserError
from core.plain_data import MOST_FILE_BYTES
from core.plain_data import read_toml as tables_in
from core.problem import Problem, ProblemError, problem_from
from core.tolerances import STRICT

SET_FILE, TARGET_FILE = "set.toml", "target.bsp"
PROBLEM_FILE, VECTOR_FILE, STATES_FILE, CERTIFICATE_FILE = (
    "problem.toml",
    "vector.csv",
    "states.csv",
    "certificate.json",
)

#: What the set of this version is called, and where it is beside the sources.
NAME, VERSION = "coastarc robust set", "2026.1"
FOLDER = Path(__file__).resolve().parents[2] / "benchmark" / f"robust-set-{VERSION}"

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
