"""`coastarc bench`: how fast this machine is at what campaigns are made of."""

import json
from dataclasses import asdict
from typing import Annotated, Any

import typer
from rich.console import Console
from threadpoolctl import threadpool_limits

from service.bench.machine import machine
from service.cli import terminal
from service.cli.bench.chain import chain
from service.cli.bench.report import report
from service.cli.bench.service import service
from service.cli.bench.solve import solve
from service.cli.options import Json

bench = typer.Typer(help="Measure the numerics, reports and the service.", no_args_is_help=True)
bench.command()(solve)
bench.command()(chain)
bench.command()(report)
bench.command()(service)

RngSeed = Annotated[int, typer.Option(min=0, help="Fixes the points.")]


@bench.callback()
def _group() -> None:
    """Measure the numerics, reports and the service."""


@bench.command()
def evaluate(
    rng_seed: RngSeed = 1,
    points: Annotated[int, typer.Option(min=3, help="Points of the box.")] = 20,
    repeats: Annotated[int, typer.Option(min=1, help="Repetitions, of which the least time counts.")] = 7,
    as_json: Json = False,
) -> None:
    """Time defects and their Jacobian for k = 0, 1, 3, 12 and N = 50, 100, beside SciPy."""
    from core.problem import load_problem
    from workers.measure_evaluation import bench_evaluate

    with threadpool_limits(1):
        rows = bench_evaluate(load_problem("ppe-drm3"), rng_seed, points, repeats)
    settings = {"rng_seed": rng_seed, "points": points, "repeats": repeats}
    if as_json:
        content = {"machine": machine(), "settings": settings, "rows": [asdict(row) for row in rows]}
        typer.echo(json.dumps(content, indent=2))
    else:
        _show(rows, settings)


def _show(rows: list[Any], settings: dict[str, int]) -> None:
    columns = (
        "k",
        "N",
        "defects",
        "with Jacobian",
        "Hessian",
        "ephemeris",
        "propagation",
        "assembly",
        "P_k/P_0",
        "SciPy/ours",
    )
    listed = terminal.table(*columns, title="CPU ms, medians over points of the least of the repetitions")
    for row in rows:
        parts = (row.ephemeris_ms, row.propagation_ms, row.assembly_ms)
        times = (row.defects_ms, row.jacobian_ms, row.hessian_ms, *parts)
        ratio = "-" if row.scipy_over_ours is None else f"{row.scipy_over_ours:.0f}"
        shown = (f"{time:.3f}" for time in times)
        listed.add_row(str(row.k), str(row.n_segments), *shown, f"{row.cost_over_p0:.2f}", ratio)
    console = Console(width=120)
    console.print(listed)
    for name, value in (machine() | settings).items():
        console.print(f"{name}: {value}", highlight=False)
