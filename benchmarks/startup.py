"""What commands cost that only look at a small archive: `python -m benchmarks.startup`."""

import json
import os
import resource
import subprocess
import sys
from importlib.resources import files
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
import typer

from benchmarks.archive import fill, require_folder
from service.spec import load_spec
from workers.provenance import machine

#: What is typed after `coastarc`; those that look at an archive get its folder too.
COMMANDS = (
    "--help",
    "status",
    "status --campaign 1",
    "solutions list",
    "solutions list --json",
    "token list",
)
#: What any command that opens an archive imports besides our own code.
REFERENCE = "import pydantic.main, rich.table, sqlalchemy.orm, typer"


def main(
    repeats: Annotated[int, typer.Option(min=1, max=1000, help="Runs of each command.")] = 9,
    outcomes: Annotated[int, typer.Option(min=1, max=10_000, help="Solves in the archive.")] = 100,
) -> None:
    """Print the processor seconds of whole processes, as JSON: least, median and greatest of their runs."""
    with TemporaryDirectory() as place:
        require_folder(Path(place))
        spec = load_spec(Path(str(files("service.spec") / "templates" / "quick.toml")))
        # Active, so that `status` shows its searches.
        fill(Path(place), spec, outcomes, np.random.default_rng(1), is_done=False)
        program = str(Path(sys.executable).with_name("coastarc"))
        typed = {REFERENCE: [sys.executable, "-c", REFERENCE]}
        for words in COMMANDS:
            where = ["--data", place] if words != "--help" else []
            typed[f"coastarc {words}"] = [program, *words.split(), *where]
        seconds = measure(typed, repeats)
    typer.echo(json.dumps({"machine": machine(), "repeats": repeats, "cpu_seconds": seconds}, indent=2))


def measure(typed: dict[str, list[str]], repeats: int) -> dict[str, dict[str, float]]:
    """Return what processes take, in turn, so that what else the machine does meets all alike [s]."""
    for arguments in typed.values():
        # Reads the files into memory, and compiles what is new.
        cpu_seconds(arguments)
    rounds = [{name: cpu_seconds(arguments) for name, arguments in typed.items()} for _ in range(repeats)]
    return {name: _spread([one[name] for one in rounds]) for name in typed}


def cpu_seconds(arguments: list[str]) -> float:
    """Return the processor time of a process, and of those that it starts [s]."""
    compiles = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(arguments, env=compiles, stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def _spread(seconds: list[float]) -> dict[str, float]:
    found = {"least": min(seconds), "median": median(seconds), "greatest": max(seconds)}
    return {name: round(value, 3) for name, value in found.items()}


if __name__ == "__main__":
    typer.run(main)
