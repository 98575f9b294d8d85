"""Published problems solved from uniform guesses: how often, how well and how fast; `coastarc bench oracles`.

Each case is a transfer of fixed duration between two states, about the Sun or between two bodies on circles.
Its target is made a kernel: the orbit that passes through the end state without thrust.  Masses are in kg,
times in CPU seconds of this thread.
"""

import functools
import math
import time
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import spiceypy
from numpy.typing import NDArray

import core
from core.constants import G0, SECONDS_PER_DAY
from core.ephemeris.spk import ChebyshevOrbit, write_orbit
from core.ephemeris.tables import coefficients_through, record_nodes
from core.epochs import seconds_past_j2000
from core.problem import Problem, problem_from
from core.units import LU_KM, TU_DAYS, TU_S, VU_KM_S

Array = NDArray[np.float64]

#: The published problems do not depend on it.
EPOCH = "2030-01-01T00:00:00"
TARGET_ID = -90001
#: How much shorter than published a transfer may be, since bounds need a width [days].
SLACK_DAYS = 1e-3
#: Around the flight, the target and the bodies are known for so long [days].
MARGIN_DAYS = 60.0
#: A mass so near to the best counts as the same optimum [-].
NEAR = 1e-5
#: Mass that nondimensional problems get [kg].
CIRCLE_MASS_KG = 1000.0
#: Coefficients of a record of the kernels that are made here.
_N_COEFFICIENTS = 20


@dataclass(frozen=True, slots=True)
class OracleResult:
    """One case: what came of its guesses, beside what was published."""

    id: str
    title: str
    source: str
    n_segments: int
    n_guesses: int
    n_strict: int
    #: Strict solutions within `NEAR` of the best.
    n_best: int
    #: Greatest final mass of a strict solution, in the unit of the published one; None without any.
    best: float | None
    published: float
    unit: str
    #: CPU time of all guesses over their number, and over the strict ones [s].
    cpu_seconds_per_guess: float
    cpu_seconds_per_strict: float | None


@functools.cache
def cases() -> dict[str, Mapping[str, Any]]:
    """Return the published cases by id."""
    table = tomllib.loads((files("workers") / "oracles.toml").read_text(encoding="utf-8"))
    return {case["id"]: case for case in table["case"]}


def problem_of(case: Mapping[str, Any], folder: Path, n_segments: int | None = None) -> Problem:
    """Return the problem of a case; its kernels are written to a folder, which has to stay."""
    make = _about_the_sun if "gm_km3_s2" in case else _on_circles
    return problem_from(make(case, folder) | {"n_segments": n_segments or case["n_segments"]})


def run_case(
    case: Mapping[str, Any], folder: Path, n_guesses: int, rng_seed: int, n_segments: int | None = None
) -> OracleResult:
    """Solve uniform guesses of a case, verify what is feasible, and compare."""
    problem = problem_of(case, folder, n_segments)
    transcription, rng = core.transcribe(problem), np.random.default_rng(rng_seed)
    unit = 1.0 if case["unit"] == "kg" else problem.spacecraft.wet_mass_kg
    masses, seconds = [], 0.0
    for _ in range(n_guesses):
        guess, began = core.sample_guess(transcription, rng), time.thread_time()
        outcome = core.solve(transcription, guess)
        seconds += time.thread_time() - began
        if outcome.is_feasible and core.verify(problem, outcome.x).strict:
            masses.append(outcome.objective / unit)
    best = max(masses, default=None)
    return OracleResult(
        *(case["id"], case["title"], case["source"], problem.n_segments, n_guesses, len(masses)),
        n_best=0 if best is None else sum(mass > (1.0 - NEAR) * best for mass in masses),
        best=best,
        published=case["published"],
        unit=case["unit"],
        cpu_seconds_per_guess=seconds / n_guesses,
        cpu_seconds_per_strict=seconds / len(masses) if masses else None,
    )


def run_cases(names: list[str], folder: Path, n_guesses: int, rng_seed: int) -> Iterator[OracleResult]:
    """Yield the results of the cases named, or of all if none is."""
    for name in names or list(cases()):
        yield run_case(cases()[name], folder, n_guesses, rng_seed)


def _about_the_sun(case: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    gm, days, coast_days = case["gm_km3_s2"], case["days"], case.get("coast_days", 0.0)
    end = np.array([*case["end_position_km"], *case["end_velocity_km_s"]])

    def place(seconds: float) -> Array:
        return np.asarray(spiceypy.prop2b(gm, end, seconds - days * SECONDS_PER_DAY)[:3])

    return {
        "world": {"center": "SUN", "gm_km3_s2": [gm]},
        "target": _target(case, folder, place, center=10, days=days + coast_days, record_days=8.0),
        **_craft(case["mass_kg"], case["max_thrust_n"], case["exhaust_velocity_km_s"]),
        "departure": _departure(case["position_km"], case["velocity_km_s"], case["mass_kg"]),
        "bounds": _bounds(days, case["mass_kg"], coast_days),
    }


def _on_circles(case: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    mu, days = case["mu"], case["time"] * TU_DAYS
    gm = LU_KM**3 / TU_S**2
    kernel = folder / f"{case['id']}-bodies.bsp"
    _write(kernel, 301, 399, lambda s: LU_KM * _turned(s / TU_S, np.array([1.0, 0.0, 0.0])), days, 1.0)
    path = _free_path(mu, case["time"], np.array(case["end_state"]))
    moon = np.array([1.0 - mu, 0.0, 0.0])
    state = np.array(case["state"])
    position = state[:3] + np.array([mu, 0.0, 0.0])
    velocity = state[3:] + np.cross([0.0, 0.0, 1.0], position)
    thrust_n = case["max_thrust"] * LU_KM / TU_S**2 * 1e3 * CIRCLE_MASS_KG
    return {
        "world": {"bodies": ["MOON"], "kernel": str(kernel), "gm_km3_s2": [(1.0 - mu) * gm, mu * gm]},
        "target": _target(
            case,
            folder,
            lambda s: LU_KM * _turned(s / TU_S, path(s / TU_S)[:3] - moon),
            center=301,
            days=days,
            record_days=1.0 / 12.0,
        ),
        **_craft(CIRCLE_MASS_KG, thrust_n, case["exhaust_velocity"] * VU_KM_S),
        "departure": _departure((position * LU_KM).tolist(), (velocity * VU_KM_S).tolist(), CIRCLE_MASS_KG),
        "bounds": _bounds(days, CIRCLE_MASS_KG),
    }


def _turned(angle: float, place: Array) -> Array:
    """Return a place of the rotating frame in inertial axes."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * place[0] - s * place[1], s * place[0] + c * place[1], place[2]])


def _free_path(mu: float, end: float, state: Array) -> Callable[[float], Array]:
    """Return the ballistic path in the rotating frame that passes a state at a time, by SciPy."""
    first, second = np.array([-mu, 0.0, 0.0]), np.array([1.0 - mu, 0.0, 0.0])

    def rates(_: float, y: Array) -> Array:
        to_first, to_second = y[:3] - first, y[:3] - second
        pull = -(1.0 - mu) * to_first / np.linalg.norm(to_first) ** 3
        pull -= mu * to_second / np.linalg.norm(to_second) ** 3
        turning = np.array([y[0] + 2.0 * y[4], y[1] - 2.0 * y[3], 0.0])
        return np.concatenate([y[3:], pull + turning])

    margin = MARGIN_DAYS / TU_DAYS
    before, after = (
        scipy.integrate.solve_ivp(
            rates, (end, stop), state, method="DOP853", rtol=1e-13, atol=1e-13, dense_output=True
        ).sol
        for stop in (-0.1, end + margin)
    )
    return lambda moment: np.asarray((before if moment <= end else after)(moment))


def _target(
    case: Mapping[str, Any],
    folder: Path,
    place: Callable[[float], Array],
    *,
    center: int,
    days: float,
    record_days: float,
) -> dict[str, Any]:
    path = folder / f"{case['id']}.bsp"
    _write(path, TARGET_ID, center, place, days, record_days, before_days=0.1)
    return {"kind": "spk", "path": str(path), "naif_id": TARGET_ID}


def _write(
    path: Path,
    body: int,
    center: int,
    place: Callable[[float], Array],
    days: float,
    record_days: float,
    before_days: float = MARGIN_DAYS,
) -> None:
    """Write the places [km] of a body, by seconds past the epoch, as a kernel."""
    start, stop = -before_days, days + 0.9 * MARGIN_DAYS
    n_records = math.ceil((stop - start) / record_days)
    length = (stop - start) * SECONDS_PER_DAY / n_records
    nodes = record_nodes(start * SECONDS_PER_DAY, length, n_records, _N_COEFFICIENTS)
    places = np.array([[place(moment) for moment in record] for record in nodes.tolist()])
    start_et = seconds_past_j2000(EPOCH) + start * SECONDS_PER_DAY
    orbit = ChebyshevOrbit(start_et, length, coefficients_through(places))
    write_orbit(path, body, orbit, "Made by coastarc for a published problem.", center)


def _craft(mass_kg: float, thrust_n: float, exhaust_velocity_km_s: float) -> dict[str, Any]:
    isp_s = exhaust_velocity_km_s * 1e3 / G0
    masses = {"wet_mass_kg": mass_kg, "dry_mass_kg": 0.2 * mass_kg}
    return {"spacecraft": masses | {"max_thrust_n": thrust_n, "isp_s": isp_s}}


def _departure(position_km: list[float], velocity_km_s: list[float], mass_kg: float) -> dict[str, Any]:
    state = {"position_km": position_km, "velocity_km_s": velocity_km_s}
    return {"kind": "state", "epoch": EPOCH, "mass_kg": mass_kg} | state


def _bounds(days: float, mass_kg: float, coast_days: float = 0.0) -> dict[str, Any]:
    shooting = days - coast_days
    return {
        "shooting_days": [shooting - SLACK_DAYS, shooting],
        "initial_coast_days": [coast_days, coast_days + SLACK_DAYS],
        "final_coast_days": [0.0, SLACK_DAYS],
        "min_final_mass_kg": 0.2 * mass_kg,
    }
