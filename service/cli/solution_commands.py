"""`coastarc solutions export|reproduce|verify|refine`: commands that propagate or solve."""

import io
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.live import Live
from rich.table import Table

from core.export.spk import FIRST_ID
from service import logs
from service.cli import terminal
from service.cli.options import (
    DATA,
    WORKERS,
    Data,
    Json,
    MaybeUrl,
    Workers,
    client_of,
    console,
    print_json,
)
from service.cli.run import reopen, run_to_end, worker_setup
from service.cli.terminal import (
    summary_line,
    verified_list,
    verify_progress_line,
)
from service.coordinator import Coordinator
from service.new_file import write_new
from service.schemas.solution import Reproduction
from service.solutions.export import ALL, ExportFormat, Wanted, export_solution
from service.solutions.refine import Step, best_of, check_segments, first_step, next_step, refinement_spec
from service.solutions.reproduce import Comparison, reproduce, verdict
from service.solutions.verification import (
    Summary,
    VerificationRequest,
    Verified,
    fresh_ids,
    require_heyoka,
    verify_solutions,
    wanted_ids,
)
from service.spec.spec_check import require_flyable
from service.store.store import Store
from workers.dispatch import ExecutorKind
from workers.messages import Job, JobOutcome

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

#: With more good solutions than this, only those that failed are listed.
MOST_LISTED = 50
#: Shortest period of redrawing the line of progress [s].
PERIOD_S = 0.5


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
    """Solve a solution again in more segments, each step from the one before, and show the gain in mass.

    The guess is the trajectory of the seed, unchanged; each result is stored with its lineage.
    Exit code 1 if a step finds no solution.
    """
    logs.configure(level="WARNING")
    with Store(data, read_only=True) as store:
        steps = [first_step(store, store.record(store.find_solution(solution)))]
    check_segments(steps[0].n_segments, segments)
    limits = {"max_iterations": max_iterations, "cpu_seconds": cpu_seconds, "integrator_tolerance": tolerance}
    given = {name: value for name, value in limits.items() if value is not None}
    # Lines of progress must not be mixed with the JSON.
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
        setup = worker_setup(ExecutorKind.PROCESS, 1)
        if reopen(store, campaign_id) and not run_to_end(shown, coordinator, campaign_id, setup):
            return 130, "Interrupted; results are kept, and the same command resumes."
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
            "strict" if step.strict else "loose",
            step.status.lower().replace("_", " "),
            f"{step.final_mass_kg:.3f}",
            *([f"{step.gain_kg:+.3f}", f"{step.total_gain_kg:+.3f}"] if step.campaign_id else ["-", "-"]),
            f"{step.cpu_seconds:.1f}",
        )
    return rows


def reproduce_command(
    solution: Annotated[
        str, typer.Argument(help="Id of a solution, or its beginning; all of it with --url.")
    ],
    data: Data = DATA,
    url: MaybeUrl = None,
    as_json: Json = False,
) -> None:
    """Rerun the job of a solution on this machine and compare every bit; exit code 1 if one differs."""
    wanted = _reproduction(solution, data, url)
    if not as_json:
        console.print(_job_text(wanted), highlight=False, markup=False)
    comparison = reproduce(wanted, _runner)
    if as_json:
        print_json(comparison)
    else:
        _show_comparison(comparison)
    if not comparison.is_same:
        raise typer.Exit(1)


def _reproduction(solution: str, data: Data, url: str | None) -> Reproduction:
    if url is not None:
        with client_of(url) as client:
            return client.reproduction(solution)
    with Store(data, read_only=True) as store:
        return store.reproduction(store.find_solution(solution))


def _runner(job: Job) -> JobOutcome:
    # Importing it takes seconds, which other commands need not wait for.
    from workers.run import run_job

    return run_job(job)


def _job_text(wanted: Reproduction) -> str:
    place = wanted.job.address
    what = f"{wanted.job.n_hops} solves" if wanted.job.kind == "hop" else f"1 solve, {wanted.job.mapping}"
    took = f"the last took {wanted.cpu_seconds:.1f} s of processor time"
    return (
        f"Solution {wanted.id}\nJob: {wanted.job.kind}, rng_seed {wanted.job.rng_seed}, "
        f"search {place.search}, case {place.case}, chain {place.chain}, hop {place.hop}; {what}; {took}."
    )


def _show_comparison(comparison: Comparison) -> None:
    console.print(verdict(comparison), highlight=False, markup=False)
    if not comparison.differences:
        console.print("Code, packages, kernels and host are unchanged.")
        return
    rows = terminal.table("differs", "then", "now")
    for difference in comparison.differences:
        rows.add_row(difference.what, difference.then, difference.now)
    console.print(rows)


SolutionIds = Annotated[list[str] | None, typer.Argument(help="Ids of solutions, or their beginnings.")]
OfCampaign = Annotated[str | None, typer.Option(help="All of this campaign, by its id or name.")]
OfArchive = Annotated[bool, typer.Option("--all", metavar="", help="All of the archive.")]
MinAltitude = Annotated[
    float | None,
    typer.Option(
        show_default="200 over the Earth, 100 over the Moon",
        help="Passages of Earth or Moon below so many km are marked.",
    ),
]
Stale = Annotated[
    bool,
    typer.Option(
        "--stale",
        metavar="",
        help="Skip those found sound with this code, these packages, this altitude.",
    ),
]
WithHeyoka = Annotated[
    bool,
    typer.Option("--with-heyoka", metavar="", help="Propagate end to end by heyoka's Taylor series, too."),
]


def verify_command(
    solution: SolutionIds = None,
    campaign: OfCampaign = None,
    is_all: OfArchive = False,
    data: Data = DATA,
    min_altitude_km: MinAltitude = None,
    is_stale: Stale = False,
    with_heyoka: WithHeyoka = False,
    workers: Workers = WORKERS,
    as_json: Json = False,
) -> None:
    """Verify solutions by an independent integrator, and store a certificate of each.

    Exit code 1 if one fails: it meets no tolerance, or a looser one than archived, or passes too low.
    Results survive an interruption; repeat the command with --stale to verify the rest.
    """
    if with_heyoka:
        require_heyoka()
    asked = VerificationRequest(min_altitude_km, with_heyoka)
    with Store(data) as store:
        ids = wanted_ids(store, solution or [], campaign, is_all=is_all)
        left = fresh_ids(store, ids, asked) if is_stale else ids
        found = verify_solutions(store, left, asked, min(workers, len(left)) or 1)
        items, is_complete = _collect(found, len(left), is_quiet=as_json)
    summary = Summary(
        n_wanted=len(ids),
        n_verified=len(items),
        n_failed=sum(not item.is_good for item in items),
        n_skipped=len(ids) - len(left),
        is_complete=is_complete,
        items=items,
    )
    print_json(summary) if as_json else _show_certificates(summary)
    if not is_complete:
        raise typer.Exit(130)
    if summary.n_failed:
        raise typer.Exit(1)


def _collect(found: Iterator[Verified], n: int, is_quiet: bool) -> tuple[list[Verified], bool]:
    """Collect verifications, showing a line of progress; also return whether they came to their end."""
    items: list[Verified] = []
    began = drawn = time.monotonic()
    with Live("", console=console, transient=True, auto_refresh=False) as live:
        try:
            for item in found:
                items.append(item)
                now = time.monotonic()
                if console.is_terminal and not is_quiet and now > drawn + PERIOD_S:
                    live.update(verify_progress_line(items, n, now - began), refresh=True)
                    drawn = now
        except KeyboardInterrupt:
            return items, False
    return items, True


def _show_certificates(summary: Summary) -> None:
    good = [item for item in summary.items if item.is_good]
    listed = [item for item in summary.items if not item.is_good]
    listed = good + listed if len(good) <= MOST_LISTED else listed
    if listed:
        console.print(verified_list(listed))
    for item in summary.items:
        for reason in item.reasons:
            console.print(f"{item.solution_id[:8]}: {reason}", soft_wrap=True, highlight=False, markup=False)
    console.print(summary_line(summary), highlight=False, soft_wrap=True)
