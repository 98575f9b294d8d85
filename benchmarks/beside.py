"""Published problems by us, and by pykep's legs with pygmo's IPOPT: `python -m benchmarks.beside`.

pykep and pygmo need versions of libraries that collide with ours, so they live in an environment of their
own, which is made on the first run.  Both solve as many guesses of their own, uniform in the box; a guess
counts if its defects are within the strict tolerance of the world, ours by the independent verification,
theirs by their own propagation at 1e-16.
"""

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

from core.cache import cache_folder
from core.world import world_of
from workers.measure_oracles import cases, problem_of, run_case
from workers.provenance import machine

#: What is installed there; other versions may have other interfaces.
PACKAGES = ("pykep==3.0.1", "pygmo==2.20.0")
#: Files of pykep that its wheel lacks, and reads when it is imported.
LACKING = ("cr3bp", "twobody", "ss", "mee")
SOLVER = Path(__file__).with_name("pykep_solves.py")
#: Both work on one thread.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def main(
    case: Annotated[list[str] | None, typer.Option(help="Only these cases; may be repeated.")] = None,
    guesses: Annotated[int, typer.Option(min=1, max=1000, help="Guesses of each case.")] = 10,
    rng_seed: Annotated[int, typer.Option(min=0, help="Fixes the guesses of both.")] = 1,
) -> None:
    """Print for each case what both found, their CPU seconds, and the ratio of solutions per CPU second."""
    python = environment(cache_folder() / "pykep")
    # A forced coast is not one of pykep's problems between two points.
    chosen = [one for one in cases().values() if "coast_days" not in one and one["id"] in (case or cases())]
    with TemporaryDirectory() as place:
        rows = [beside(python, one, Path(place), guesses, rng_seed) for one in chosen]
    typer.echo(json.dumps({"machine": machine(), "packages": PACKAGES, "cases": rows}, indent=2))


def environment(folder: Path) -> str:
    """Return the Python of an environment with pykep and pygmo, which is made if it is not there."""
    python = folder / "bin" / "python"
    if not (folder / "is_made").exists():
        subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
        (gym,) = folder.glob("lib/*/site-packages/pykep/trajopt/gym")
        (gym / "tops").mkdir(exist_ok=True)
        for name in LACKING:
            (gym / "tops" / f"_tops_{name}.json").write_text("{}\n")
        (folder / "is_made").touch()
    return str(python)


def beside(
    python: str, case: Mapping[str, Any], folder: Path, n_guesses: int, rng_seed: int
) -> dict[str, Any]:
    """Return what both make of one case; theirs and ours run one after the other."""
    problem = problem_of(case, folder)
    world = world_of(problem)
    asked = {
        "case": dict(case),
        "n_guesses": n_guesses,
        "rng_seed": rng_seed,
        "units": [world.units.lu_km, world.units.vu_km_s],
        "strict": [world.strict.position_km, world.strict.velocity_km_s, world.strict.mass_kg],
        "mass_kg": problem.spacecraft.wet_mass_kg,
    }
    theirs = json.loads(
        subprocess.run(
            [python, SOLVER],
            input=json.dumps(asked),
            capture_output=True,
            text=True,
            check=True,
            env=os.environ | ONE_THREAD,
        ).stdout
    )
    ours = run_case(case, folder, n_guesses, rng_seed)
    seconds = ours.cpu_seconds_per_guess * n_guesses
    mine = {"n_strict": ours.n_strict, "best": ours.best, "cpu_seconds": seconds}
    rate, other = ours.n_strict / seconds, theirs["n_strict"] / theirs["cpu_seconds"]
    return {
        **{key: case[key] for key in ("id", "n_segments", "published", "unit")},
        "n_guesses": n_guesses,
        "coastarc": mine,
        "pykep": theirs,
        "solutions_per_cpu_second_ratio": rate / other if other else None,
    }


if __name__ == "__main__":
    typer.run(main)
