"""`coastarc analyse`: how one solution responds to outages, computed by a campaign of its own."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from rich.console import Console

from core.problem import problem_from
from service import logs
from service.cli import terminal
from service.cli.options import DATA, WORKERS, Data, Json, Workers, client_of, console, print_json
from service.cli.run import LOG_PERIOD_S, announce, reopen, run_to_end, worker_setup
from service.client import Client
from service.coordinator import Coordinator, WorkerSetup
from service.db.transitions import ENDED
from service.new_file import require_folder
from service.schemas.solution import MissedThrustView, Record
from service.solutions.missed_thrust import views_of
from service.spec import spec_from
from service.spec.missed_thrust import USUAL_DURATIONS, analysis_spec, grid_of
from service.store.errors import StoreError
from service.store.store import Store
from workers.dispatch import ExecutorKind

analyse = typer.Typer(help="Analyse how a solution responds to outages.", no_args_is_help=True)

Solution = Annotated[str, typer.Argument(help="Id of a solution, or its beginning; all of it with --url.")]
Beside = Annotated[
    str | None,
    typer.Option(help="Analyse another solution as well, and show both; `seed` is the one it was made from."),
]
Segments = Annotated[
    str | None,
    typer.Option(
        help="Where outages begin, START:STOP:STEP or a list; every other segment and those of its own "
        "outages if left out."
    ),
]
Durations = Annotated[str, typer.Option(help="How long they last in days, START:STOP:STEP or a list.")]
Out = Annotated[
    Path | None, typer.Option(help="Folder for page and pictures; missed-thrust-ID here if left out.")
]
Url = Annotated[
    str | None,
    typer.Option(help="Run the analysis on this coordinator and its workers.", envvar="COASTARC_URL"),
]


@analyse.callback()
def _root() -> None:
    """Keep the name of the only subcommand."""


@analyse.command("missed-thrust")
def missed_thrust_command(
    solution: Solution,
    beside: Beside = None,
    segments: Segments = None,
    durations: Durations = USUAL_DURATIONS,
    data: Data = DATA,
    url: Url = None,
    workers: Workers = WORKERS,
    executor: Annotated[ExecutorKind, typer.Option(help="What runs the jobs here.")] = ExecutorKind.PROCESS,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Map which outages a solution recovers from, at what price; repeat the command to resume after Ctrl-C.

    The reference is followed until the outage; the rest is re-optimized. Every recovery is a certified
    solution of the archive.
    """
    # Progress must not be mixed with the JSON.
    shown = Console(stderr=True) if as_json else console
    logs.configure(level="WARNING")
    outages = OutageRequest(segments, durations)
    if not as_json:
        require_folder(out or Path())
    if url is not None:
        with client_of(url) as client:
            views = [
                _remote(shown, client, one, outages) for one in _records(client.record, solution, beside)
            ]
    else:
        with Store(data, read_only=True) as store:
            ids = _records(lambda prefix: store.record(store.find_solution(prefix)), solution, beside)
        views = [_local(shown, data, one, outages, worker_setup(executor, workers)) for one in ids]
    if as_json:
        print_json(views[0] if beside is None else views)
    else:
        _show(views, out or Path(f"missed-thrust-{views[0].solution_id[:8]}"))


class OutageRequest(NamedTuple):
    """The outages as the user typed them."""

    segments: str | None
    durations: str

    def fields(self, record: Record, definition: dict[str, Any]) -> dict[str, Any]:
        """Return the specification of the analysis of a solution."""
        problem = problem_from(definition)
        grid = grid_of(problem, self.segments, self.durations)
        return analysis_spec(record.id, problem, grid, "strict" if record.strict else "paper")


def _records(record: Callable[[str], Record], solution: str, beside: str | None) -> list[Record]:
    """Return the solutions to analyse."""
    first = record(solution)
    if beside is None:
        return [first]
    if beside == "seed" and first.seed_id is None:
        raise StoreError(f"--beside seed: expected a solution with a seed, got {first.id[:8]} without one")
    return [first, record(first.seed_id or "" if beside == "seed" else beside)]


def _local(
    shown: Console, data: Path, record: Record, outages: OutageRequest, setup: WorkerSetup
) -> MissedThrustView:
    with Coordinator(data) as coordinator:
        store = coordinator.store
        definition, _ = store.definition_and_vector(record.id)
        campaign_id, _ = store.submit(spec_from(outages.fields(record, definition), allow_files=True))
        if reopen(store, campaign_id):
            announce(shown, coordinator, f"/campaigns/{campaign_id}")
            if not run_to_end(shown, coordinator, campaign_id, setup):
                # Results so far are kept.
                raise KeyboardInterrupt
        return _single(record, views_of(store, record.id, campaign_id))


def _remote(shown: Console, client: Client, record: Record, outages: OutageRequest) -> MissedThrustView:
    definition = client.problem(record.problem_hash).definition
    view, _ = client.submit(outages.fields(record, definition))
    while view.state not in ENDED:
        shown.print(terminal.progress_line(view), highlight=False)
        time.sleep(LOG_PERIOD_S)
        view = client.campaign(view.id)
    return _single(record, client.missed_thrust(record.id, view.id).items)


def _single(record: Record, views: list[MissedThrustView]) -> MissedThrustView:
    if not views:
        raise StoreError(
            f"missed-thrust analysis of {record.id[:8]}: expected a solve, got none; look at its dead jobs"
        )
    return views[0]


def _show(views: list[MissedThrustView], folder: Path) -> None:
    # Importing matplotlib takes a second.
    from service.report.missed_thrust import segment_table, summary_table, write_missed_thrust

    for table in (segment_table(views), summary_table(views)):
        rows = terminal.table(*(column.head for column in table.columns), title=table.title)
        for row in table.rows:
            rows.add_row(*(column.text(cell) for column, cell in zip(table.columns, row, strict=True)))
        console.print(rows)
    path = write_missed_thrust(views, folder)
    console.print(f"Page and pictures: {path.resolve()}", highlight=False, soft_wrap=True, markup=False)
