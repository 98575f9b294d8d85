"""`coastarc benchmark`: the open set of robust problems with solutions to beat."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from service.cli import terminal
from service.cli.options import Json, console, print_json, show_checks
from service.problem_set import FOLDER, BenchmarkError, BenchmarkSet, read_set

benchmark = typer.Typer(
    help="Show and check the open set of robust problems; compare solutions with it.", no_args_is_help=True
)

Folder = Annotated[Path, typer.Argument(help="Folder of a set; the one beside the sources if left out.")]
FolderOption = Annotated[Path, typer.Option("--folder", help="Folder of a set.")]
CaseNames = Annotated[list[str] | None, typer.Option("--case", help="Only this case; may be repeated.")]


@benchmark.command()
def show(folder: Folder = FOLDER, as_json: Json = False) -> None:
    """Show the problems of a set and the solution to beat of each, as its files say."""
    found = read_set(folder)
    cases = [_case_fields(found, name) for name in (case.name for case in found.cases)]
    if as_json:
        print_json({"name": found.name, "version": found.version, "folder": str(folder), "cases": cases})
        return
    rows = terminal.table("case", "outages at segments", "days", "variables", "propellant, kg", "solution")
    for case in cases:
        segments = "-".join(str(outage["segment"]) for outage in case["outages"]) or "none"
        days = ", ".join(sorted({f"{outage['duration_days']:g}" for outage in case["outages"]}))
        numbers = str(case["n_variables"]), f"{case['propellant_kg']:.3f}"
        rows.add_row(case["name"], segments, days, *numbers, case["solution"][:8])
    console.print(rows)
    console.print(f"{found.name} {found.version}, {folder}", highlight=False, markup=False)


def _case_fields(found: BenchmarkSet, name: str) -> dict[str, Any]:
    from core.transcription import layout_of

    case = found.case(name)
    problem = case.problem()
    return {
        "name": name,
        "outages": [outage.model_dump() for outage in problem.outages],
        "n_variables": layout_of(problem).n_variables,
        "propellant_kg": case.propellant_kg,
        "problem": case.problem_hash,
        "solution": case.solution,
    }


@benchmark.command()
def check(folder: Folder = FOLDER, case: CaseNames = None, as_json: Json = False) -> None:
    """Check a set from its files alone: every solution is verified again; exit code 1 if a check fails."""
    from service.problem_set import check_set

    checks = list(check_set(read_set(folder), tuple(case or ())))
    show_checks(checks, as_json)


@benchmark.command()
def judge(
    case: Annotated[str, typer.Argument(help="Case that the solution is of, as k3.")],
    vector: Annotated[Path, typer.Argument(help="File with the decision vector, as vector.csv of the case.")],
    folder: FolderOption = FOLDER,
    as_json: Json = False,
) -> None:
    """Verify a solution from elsewhere and compare it with the set's; exit code 1 if it is not strict."""
    from service.problem_set import judge as judged

    found = judged(read_set(folder).case(case), vector)
    if as_json:
        print_json(found)
    else:
        worst = found.failure or f"worst defect {100 * found.violation:.1f} % of the tolerance"
        console.print(f"{'Strict' if found.is_strict else 'Not strict'}: {worst}.", highlight=False)
        console.print(
            f"{found.propellant_kg:.3f} kg of propellant, {found.excess_kg:+.3f} kg compared with the set's "
            f"{found.best_known_kg:.3f} kg.",
            highlight=False,
        )
    if not found.is_strict:
        raise typer.Exit(1)


@benchmark.command()
def write(
    folder: Annotated[Path, typer.Argument(help="New folder for the set.")],
    solutions: Annotated[
        Path, typer.Argument(help="File of strict solutions, as `bench chain --save` writes.")
    ],
) -> None:
    """Write a new set of the best solution of each problem in a file."""
    from service.problem_set import write_set
    from workers.measure_solves import read_solutions

    try:
        given = read_solutions(solutions)
    except ValueError as error:
        raise BenchmarkError(str(error)) from error
    made = write_set(folder, given, datetime.now(UTC).date().isoformat())
    console.print(f"{made.name} {made.version}: {len(made.cases)} cases in {folder}", highlight=False)
