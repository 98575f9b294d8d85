"""One published problem by pykep's zero-order-hold legs and pygmo's IPOPT; run by `benchmarks.beside`.

Input: JSON on standard input.  Output: how many guesses close, the best final mass, and CPU seconds, as JSON.
Nothing of coastarc is imported here: this runs in an environment that has only pykep and pygmo.
"""

import json
import math
import sys
import time
from typing import Any

import numpy as np
import pygmo
import pykep

#: Settings of IPOPT with which its authors solve these problems, and its patience.
IPOPT = {"tol": 1e-8}, {"max_iter": 1000, "print_level": 0}
#: Tolerances of their integrators, of states and of partials: those of their own examples.
INTEGRATION, VARIATION = 1e-16, 1e-8
#: Defects below which they call a point feasible; what counts is decided here.
CLOSED = 1e-7
#: As ours, a fixed duration gets a width; their bounds may not be equal.
WIDTH = 1e-9


def main() -> None:
    """Solve what is asked."""
    asked = json.load(sys.stdin)
    make = _about_the_sun if "gm_km3_s2" in asked["case"] else _on_circles
    problem, scales = make(asked)
    # Of position [km], velocity [km/s] and mass [kg], of which the final mass is a share.
    problem, strict = pygmo.problem(problem), asked["strict"]
    # With none, a population keeps its guess where IPOPT's defects are rounding.
    problem.c_tol = CLOSED
    solver = pygmo.ipopt()
    for name, value in IPOPT[0].items():
        solver.set_numeric_option(name, value)
    for name, value in IPOPT[1].items():
        solver.set_integer_option(name, value)
    solver.set_string_option("sb", "yes")
    algorithm = pygmo.algorithm(solver)
    masses, seconds = [], 0.0
    for number in range(asked["n_guesses"]):
        guess = pygmo.population(problem, size=1, seed=1000 * asked["rng_seed"] + number)
        began = time.process_time()
        found = algorithm.evolve(guess)
        seconds += time.process_time() - began
        fitness = problem.fitness(found.champion_x)
        mismatch, throttle = fitness[1:8], fitness[8:]
        sizes = [np.linalg.norm(mismatch[:3]), np.linalg.norm(mismatch[3:6]), abs(mismatch[6])]
        closes = all(size * scale <= most for size, scale, most in zip(sizes, scales, strict, strict=True))
        if closes and max(throttle) < 1e-6:
            masses.append(float(found.champion_x[0]) * asked["mass_kg"])
    unit = 1.0 if asked["case"]["unit"] == "kg" else asked["mass_kg"]
    best = max(masses) / unit if masses else None
    json.dump({"n_strict": len(masses), "best": best, "cpu_seconds": seconds}, sys.stdout)


def _about_the_sun(asked: dict[str, Any]) -> tuple[Any, list[float]]:
    case = asked["case"]
    length = float(np.linalg.norm(case["position_km"]))
    speed = math.sqrt(case["gm_km3_s2"] / length)
    force = case["mass_kg"] * speed**2 / length * 1e3
    integrators = [pykep.ta.get_zoh_kep(INTEGRATION), pykep.ta.get_zoh_kep_var(VARIATION)]
    for one in integrators:
        one.pars[4] = speed / case["exhaust_velocity_km_s"]

    def state(which: str) -> list[float]:
        place, velocity = case[f"{which}position_km"], case[f"{which}velocity_km_s"]
        return [*(value / length for value in place), *(value / speed for value in velocity)]

    duration = case["days"] * 86400.0 * speed / length
    ends = state(""), state("end_")
    thrust = case["max_thrust_n"] / force
    scales = [length, speed, case["mass_kg"]]
    return _problem(case, ends, thrust, duration, integrators), scales


def _on_circles(asked: dict[str, Any]) -> tuple[Any, list[float]]:
    case = asked["case"]
    integrators = [pykep.ta.get_zoh_cr3bp(INTEGRATION), pykep.ta.get_zoh_cr3bp_var(VARIATION)]
    for one in integrators:
        one.pars[4], one.pars[5] = 1.0 / case["exhaust_velocity"], case["mu"]
    ends = case["state"], case["end_state"]
    problem = _problem(case, ends, case["max_thrust"], case["time"], integrators)
    return problem, [*asked["units"], asked["mass_kg"]]


def _problem(case: dict[str, Any], ends: Any, thrust: float, duration: float, integrators: list[Any]) -> Any:
    return pykep.trajopt.zoh_point2point(
        states=ends[0],
        statef=ends[1],
        ms=1.0,
        max_thrust=thrust,
        tof_bounds=[duration * (1.0 - WIDTH), duration],
        mf_bounds=[0.2, 1.0],
        nseg=case["n_segments"],
        cut=0.5,
        tas=integrators,
        time_encoding="uniform",
        inequalities_for_tc=True,
        max_steps=1000,
    )


if __name__ == "__main__":
    main()
