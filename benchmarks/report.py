"""How long the report of a large campaign takes: `python -m benchmarks.report`."""

import json
import time
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.archive import fill, require_folder
from service.cli.options import Json
from service.report import write_report
from service.spec import load_spec
from service.store.store import Store
from workers.provenance import machine


def main(
    outcomes: Annotated[int, typer.Option(min=100, max=10_000_000, help="Solves in the archive.")] = 100_000,
    spec: Annotated[
        Path | None, typer.Option(help="Specification whose searches share them; without it the paper's.")
    ] = None,
    rng_seed: Annotated[int, typer.Option(min=0, help="Fixes the archive.")] = 1,
    as_json: Json = False,
) -> None:
    """Time reading the facts of a made-up archive, and writing its report."""
    specification = load_spec(spec or Path(str(files("service.spec") / "templates" / "paper.toml")))
    with TemporaryDirectory() as place:
        folder = Path(place)
        require_folder(folder)
        campaign_id = fill(folder, specification, outcomes, np.random.default_rng(rng_seed))
        with Store(folder, read_only=True) as store:
            facts, reading = _timed(lambda: store.campaign_facts(campaign_id))
        _, writing = _timed(lambda: write_report(facts, folder / "report"))
    content: dict[str, Any] = {
        "machine": machine(),
        "settings": {"outcomes": outcomes, "solutions": len(facts.vectors), "rng_seed": rng_seed},
        "facts": reading,
        "report": writing,
    }
    if as_json:
        typer.echo(json.dumps(content, indent=2))
        return
    for name, part in content.items():
        typer.echo(f"{name}: " + ", ".join(f"{key} {value}" for key, value in part.items()))


def _timed(work: Callable[[], Any]) -> tuple[Any, dict[str, float]]:
    cpu, wall = time.process_time(), time.perf_counter()
    done = work()
    return done, {
        "cpu_seconds": round(time.process_time() - cpu, 3),
        "wall_seconds": round(time.perf_counter() - wall, 3),
    }


if __name__ == "__main__":
    typer.run(main)
