"""The command that refines a solution: the same flight in more segments, solved again."""

import io
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from service import logs
from service.cli import terminal
from service.cli.options import DATA, Data, Json, console, print_json
from service.cli.run import crew_of, run_to_end
from service.coordinator import Coordinator
from service.db.transitions import ENDED
from service.solutions.refine import Step, best_of, check_segments, first_step, next_step, refinement_spec
from service.spec.spec import require_flyable
from service.store import Store
from workers.dispatch import ExecutorKind


def refine_command(
    solution: Annotated[str, typer.Argument(help="Id of a solution, or its beginning.")],
    segments: Annotated[
        list[int], typer.Option(min=2, help="Number of segments; repeat it for a chain, as 100 then 200.")
    ],
    tolerance: Annotated[
        float | None, typer.Option(min=1e-14, max=1e-3, help="Of the integrator while mass is gained.")
    ] = None,
    max_iterations: Annotated[
        int | None, typer.Option(min=1, max=1_000_000, help="Iterations of a solve, times 1 + k.")
    ] = None,
    cpu_seconds: Annotated[
        float | None, typer.Option(min=1.0, max=86400.0, help="Processor seconds of a solve, times 1 + k.")
    ] = None,
    data: Data = DATA,
    as_json: Json = False,
) -> None:
    """Solve a solution again in more segments, each step from the one before, and say what mass is gained.

    The guess is the flight of the seed, unchanged; each result is kept with its lineage.
    Exit code 1 if a step finds no solution.
    """
    logs.configure(level="WARNING")
    with Store(data, read_only=True) as store:
        steps = [first_step(store, store.record(store.find_solution(solution)))]
    check_segments(steps[0].n_segments, segments)
    limits = {"max_iterations": max_iterations, "cpu_seconds": cpu_seconds, "integrator_tolerance": tolerance}
    given = {name: value for name, value in limits.items() if value is not None}
    # Beside JSON a line of progress would stand in the way.
    shown = Console(file=io.StringIO()) if as_json else console
    fault = next((fault for n in segments if (fault := _refine(shown, data, steps, n, given))), None)
    print_json([step.model_dump() for step in steps]) if as_json else console.print(_rows(steps))
    if fault is not None:
        code, words = fault
        typer.echo(words, err=True)
        raise typer.Exit(code)


def _refine(
    shown: Console, data: Path, steps: list[Step], n_segments: int, limits: dict[str, Any]
) -> tuple[int, str] | None:
    """Add the step to a number of segments; return exit code and reason where it fails."""
    with Coordinator(data) as coordinator:
        store = coordinator.store
        spec = refinement_spec(store, store.record(steps[-1].solution_id), n_segments, limits)
        require_flyable(spec.problem)
        campaign_id, _ = store.submit(spec)
        store.revive(campaign_id)
        if store.campaign_state(campaign_id) not in ENDED:
            if store.campaign_state(campaign_id) == "paused":
                store.control_campaign(campaign_id, "resume")
            if not run_to_end(shown, coordinator, campaign_id, crew_of(ExecutorKind.PROCESS, 1)):
                return 130, "Interrupted; what was found is kept, and the same command goes on."
        best = best_of(store, campaign_id)
        if best is None:
            return 1, (
                f"refine: expected a solution with {n_segments} segments, got none; look at "
                f"`coastarc status --campaign {campaign_id}`, or raise --max-iterations and --cpu-seconds"
            )
        steps.append(next_step(steps, best, campaign_id, n_segments))
        return None


def _rows(steps: list[Step]) -> Table:
    rows = terminal.table(
        "segments", "solution", "level", "status", "final mass, kg", "gain, kg", "in all", "CPU, s"
    )
    for step in steps:
        rows.add_row(
            str(step.n_segments),
            step.solution_id[:8],
            "strict" if step.strict else "paper",
            step.status.lower().replace("_", " "),
            f"{step.final_mass_kg:.3f}",
            *([f"{step.gain_kg:+.3f}", f"{step.total_gain_kg:+.3f}"] if step.campaign_id else ["-", "-"]),
            f"{step.cpu_seconds:.1f}",
        )
    return rows
