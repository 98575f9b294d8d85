"""The command that writes the trajectories of a solution to a file."""

import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from core.export.spk import FIRST_ID
from service.cli.options import DATA, Data, Json, console, print_json
from service.new_file import write_new
from service.solutions.export import ALL, ExportFormat, Wanted, export_solution
from service.store import Store

Format = Annotated[ExportFormat, typer.Option(help="SPICE kernel, CCSDS message, or samples as text.")]
Trajectory = Annotated[
    str, typer.Option(help="Which one: all, reference, or the number of a realization, 1 to k.")
]
Output = Annotated[
    Path | None, typer.Option("--output", "-o", help="New file; named after the solution if left out.")
]
BodyId = Annotated[
    int, typer.Option(min=-(10**8), max=-1, help="SPK id of the reference; realization i has i less.")
]


def export_command(
    solution: Annotated[str, typer.Argument(help="Id of a solution, or its beginning.")],
    format: Format,
    trajectory: Trajectory = ALL,
    output: Output = None,
    body_id: BodyId = FIRST_ID,
    data: Data = DATA,
    as_json: Json = False,
) -> None:
    """Write the reference, a realization or all of them as SPK, OEM, CSV or NDJSON."""
    with Store(data, read_only=True) as store:
        record = store.record(store.find_solution(solution))
        definition, _ = store.definition_and_vector(record.id)
    made = export_solution(record, definition, Wanted(format, trajectory, body_id), utc_now())
    path = output or Path(made.name)
    n_bytes = write_new(path, made.content)
    if as_json:
        print_json({"file": str(path), "bytes": n_bytes, "trajectories": [asdict(b) for b in made.bodies]})
        return
    for body in made.bodies:
        span = f"{body.departure_tdb} to {body.arrival_tdb} TDB"
        console.print(f"{body.body_id}  {body.trajectory}, {span}", highlight=False, markup=False)
    console.print(f"File: {path}, {n_bytes / 1e6:.2f} MB", highlight=False, markup=False)


def utc_now() -> str:
    """Return the date and time for the head of a file."""
    return time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime())
