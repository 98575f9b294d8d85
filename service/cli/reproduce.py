"""The command that finds a solution again."""

from typing import Annotated

import typer

from service.cli import terminal
from service.cli.options import DATA, Data, Json, MaybeUrl, client_of, console, print_json
from service.schemas.solution import Reproduction
from service.solutions.reproduce import Comparison, reproduce, verdict
from service.store import Store
from workers.messages import Job, JobOutcome


def reproduce_command(
    solution: Annotated[
        str, typer.Argument(help="Id of a solution, or its beginning; all of it with --url.")
    ],
    data: Data = DATA,
    url: MaybeUrl = None,
    as_json: Json = False,
) -> None:
    """Run the job of a solution again on this machine and compare every bit; exit code 1 if one differs."""
    wanted = _wanted(solution, data, url)
    if not as_json:
        console.print(_about(wanted), highlight=False, markup=False)
    comparison = reproduce(wanted, _runner)
    if as_json:
        print_json(comparison)
    else:
        _show(comparison)
    if not comparison.is_same:
        raise typer.Exit(1)


def _wanted(solution: str, data: Data, url: str | None) -> Reproduction:
    if url is not None:
        with client_of(url) as client:
            return client.reproduction(solution)
    with Store(data, read_only=True) as store:
        return store.reproduction(store.find_solution(solution))


def _runner(job: Job) -> JobOutcome:
    # Its import takes seconds, which the other commands need not wait for.
    from workers.run import run_job

    return run_job(job)


def _about(wanted: Reproduction) -> str:
    place = wanted.job.address
    what = f"{wanted.job.n_hops} solves" if wanted.job.kind == "hop" else f"1 solve, {wanted.job.mapping}"
    took = f"the last took {wanted.cpu_seconds:.1f} s of processor time"
    return (
        f"Solution {wanted.id}\nJob: {wanted.job.kind}, rng_seed {wanted.job.rng_seed}, "
        f"search {place.search}, case {place.case}, chain {place.chain}, hop {place.hop}; {what}; {took}."
    )


def _show(comparison: Comparison) -> None:
    console.print(verdict(comparison), highlight=False, markup=False)
    if not comparison.differences:
        console.print("Code, packages, kernels and host are the same as then.")
        return
    rows = terminal.table("differs", "then", "now")
    for difference in comparison.differences:
        rows.add_row(difference.what, difference.then, difference.now)
    console.print(rows)
