"""How many outcomes a coordinator takes, and how long others wait: `python -m benchmarks.service`."""

import json
import tempfile
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from benchmarks.measure import Wanted, measure
from service.cli import terminal
from service.cli.options import Json
from workers.provenance import machine

Outcomes = Annotated[int, typer.Option(min=1, help="End after so many outcomes.")]
Slots = Annotated[int, typer.Option(min=1, max=1000, help="Workers of one dispatcher.")]
Seconds = Annotated[
    float,
    typer.Option(min=0.1, help="It ends after this time if the outcomes are not there yet, in seconds."),
]
WorkersOption = Annotated[int, typer.Option("--workers", min=1, max=1000, help="Simulated workers.")]
Rate = Annotated[float, typer.Option(min=0, help="Outcomes per second that they offer; 0 all that they can.")]
Feasible = Annotated[float, typer.Option(min=0, max=1, help="Share of outcomes that are solutions.")]
Prefill = Annotated[
    int,
    typer.Option(
        "--prefill", "--solves", min=0, max=10_000_000, help="Made-up outcomes in the archive before."
    ),
]
Readers = Annotated[
    int,
    typer.Option(min=0, max=500, help="Readers that ask without a pause, a quarter of them for metrics."),
]
Folder = Annotated[Path | None, typer.Option(help="Keep the archive in this folder, which must be empty.")]


def main(
    outcomes: Outcomes = 10_000,
    workers: WorkersOption = 64,
    slots: Slots = 8,
    seconds: Seconds = 60.0,
    rate: Rate = 200.0,
    feasible: Feasible = 0.5,
    prefill: Prefill = 0,
    readers: Readers = 0,
    folder: Folder = None,
    as_json: Json = False,
) -> None:
    """Load a coordinator on SQLite with simulated workers, without solving anything."""
    if folder is not None and folder.exists() and any(folder.iterdir()):
        raise typer.BadParameter(f"expected an empty folder, got {folder}", param_hint="--folder")
    wanted = Wanted(outcomes, workers, slots, seconds, rate, feasible, prefill, readers)
    with tempfile.TemporaryDirectory(prefix="coastarc-bench-") as scratch:
        measured = measure(folder or Path(scratch), wanted)
    settings = {"outcomes": outcomes, "workers": workers, "slots": slots, "seconds": seconds, "rate": rate}
    settings |= {"feasible": feasible, "prefill": prefill, "readers": readers}
    if as_json:
        typer.echo(json.dumps({"machine": machine(), "settings": settings, **measured}, indent=2))
    else:
        _show(measured, settings)


def _slope(measured: dict[str, Any]) -> str:
    slope = measured["memory_mb_per_100_000_outcomes"]
    return (
        "too short to tell its growth" if slope is None else f"{slope:+.1f} MB per 100,000 outcomes by then"
    )


def _show(measured: dict[str, Any], settings: dict[str, Any]) -> None:
    console = Console(width=120)
    listed = terminal.table("request", "n", "p50, ms", "p99, ms", "max, ms")
    rows = {"all reads": measured["all_reads"], **measured["reads"]}
    rows |= {name: measured[name] for name in ("submits", "claims", "completions")}
    for name, times in rows.items():
        numbers = (times[key] for key in ("p50_ms", "p99_ms", "max_ms"))
        listed.add_row(name, str(times["n"]), *("-" if ms is None else f"{ms:.1f}" for ms in numbers))
    console.print(listed)
    if measured["claim_and_completion_p95_ms"] is not None:
        told = (
            f"a claim and a completion together, 95 of 100: {measured['claim_and_completion_p95_ms']:.1f} ms"
        )
        console.print(told, highlight=False)
    if measured["readers"] is not None:
        console.print(f"readers' answers: {measured['readers']['statuses']}", highlight=False)
    first, last = measured["memory_mb"]
    console.print(
        f"{measured['n_outcomes']} outcomes in {measured['seconds']:.1f} s: "
        f"{measured['outcomes_per_s']:.1f} per second, {measured['cpu_ms_per_outcome']:.2f} ms of the "
        f"coordinator's processor each, all its other work included, and "
        f"{measured['load_cpu_ms_per_outcome']:.2f} ms of the simulated workers'\n"
        f"{measured['n_locked']} times 'database is locked'; memory {first:.0f} MB, then {last:.0f} MB; "
        f"{_slope(measured)}; archive {measured['archive_mb']:.1f} MB",
        highlight=False,
    )
    for name, value in (machine() | settings | {"answers": measured["statuses"]}).items():
        console.print(f"{name}: {value}", highlight=False)


if __name__ == "__main__":
    typer.run(main)
