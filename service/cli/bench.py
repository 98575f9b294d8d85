"""`coastarc bench`: how often, how fast and how well this machine solves guesses and seeds of a problem.

Progress goes to stderr, and results survive an interruption.
"""

import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Protocol, TypeVar

import typer
from rich.console import Console
from threadpoolctl import threadpool_limits

from core.nlp import SolveSettings
from core.orbits.reach import remarks_on
from core.problem import Problem, load_problem
from service.cli import terminal
from service.cli.bench_tables import chains, distributions, failures, number, reasons, shares, thrust_line
from service.cli.command import print_warning
from service.cli.options import Json
from service.spec.spec_check import require_flyable
from workers.executor import Executor, ProcessPool
from workers.measure_chains import (
    ChainPlan,
    SolvedLink,
    as_fields,
    by_case,
    by_group,
    check_mappings,
    n_links,
    solution_of_link,
    solve_links,
    warm_up_links,
)
from workers.measure_solves import (
    DEFAULT_GROUPS,
    Case,
    FailureView,
    GuessPlan,
    Solution,
    SolvedGuess,
    distinct,
    failures_of,
    group_cases,
    load_seeds,
    n_compiled_kernels,
    parse_cases,
    read_solutions,
    solution_of,
    solve_guesses,
    summary,
    warm_up,
    write_json,
    write_solutions,
)
from workers.provenance import machine

Plan = TypeVar("Plan")
Solved = TypeVar("Solved")

#: Period of lines of progress where lines cannot be overwritten [s].
QUIET_S = 30.0


@contextmanager
def user_errors() -> Iterator[None]:
    """Report an error of the user in one line, with exit code 2."""
    try:
        yield
    except ValueError as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(2) from error


def _flyable(path_or_preset: str) -> Problem:
    """Return a problem whose departure, target and world can be made: workers would all find out."""
    problem = load_problem(path_or_preset)
    require_flyable(problem, "problem")
    return problem


def require_folders(**files: Path | None) -> None:
    """Refuse files that could not be written when the work is done; the names are those of the options."""
    for name, path in files.items():
        if path is not None and (path.is_dir() or not path.absolute().parent.is_dir()):
            raise ValueError(f"{name}: expected a file in a folder that exists, got {path}")


class Progress:
    """One line on stderr that is overwritten; in a file, one line every half minute."""

    def __init__(self) -> None:
        self._is_terminal = sys.stderr.isatty()
        self._next = 0.0

    def show(self, line: str) -> None:
        """Show the current state."""
        if self._is_terminal:
            sys.stderr.write(f"\r{line}\x1b[K")
        elif time.monotonic() >= self._next:
            self._next = time.monotonic() + QUIET_S
            sys.stderr.write(line + "\n")
        sys.stderr.flush()

    def end(self) -> None:
        """End the line, so that the next output begins on a new one."""
        if self._is_terminal:
            sys.stderr.write("\n")
            sys.stderr.flush()


class Ledger:
    """Saves the JSON of a benchmark to disk as results come in."""

    def __init__(self, path: Path | None, content: Callable[[bool], dict[str, Any]]) -> None:
        #: `content(is_partial)` gives all that is known.
        self._path, self._content = path, content

    def save(self) -> None:
        """Save the results so far, so that a kill loses none of them."""
        if self._path is not None and str(self._path) != "-":
            write_json(self._path, self._content(True))

    def close(self, is_partial: bool) -> bool:
        """Write everything; return whether it went to stdout ("-"), where nothing else should go."""
        if self._path is None:
            return False
        if str(self._path) == "-":
            typer.echo(json.dumps(self._content(is_partial), indent=1))
            return True
        write_json(self._path, self._content(is_partial))
        return False


class Report(Protocol[Plan, Solved]):
    """The results of a long benchmark so far."""

    plan: Plan
    solved: list[Solved]
    #: Kernels that were compiled while timing: any of them spoils the times.
    n_compiled: int

    def line(self) -> str:
        """Return the current state in one line."""


@contextmanager
def process_pool(n_workers: int) -> Iterator[Executor]:
    """Start processes to solve on, and end them."""
    pool = ProcessPool(n_workers)
    try:
        yield pool
    finally:
        pool.close()


def run_until_interrupted(
    found: Report[Plan, Solved],
    ledger: Ledger,
    n_workers: int,
    warm_up: Callable[[Executor, Plan], None],
    solve_all: Callable[[Executor, Plan], Iterator[Solved]],
) -> bool:
    """Solve until all is done or until Ctrl-C; return whether it was interrupted."""
    progress = Progress()
    try:
        with process_pool(n_workers) as pool:
            warm_up(pool, found.plan)
            before = n_compiled_kernels()
            for one in solve_all(pool, found.plan):
                found.solved.append(one)
                found.n_compiled = n_compiled_kernels() - before
                progress.show(found.line())
                ledger.save()
    except KeyboardInterrupt:
        return True
    finally:
        progress.end()
    return False


def print_facts(console: Console, facts: Mapping[str, Any]) -> None:
    """Print what the numbers depend on, one per line."""
    for name, value in facts.items():
        console.print(f"{name}: {value}", highlight=False, soft_wrap=True)


DEFAULTS = SolveSettings()

Workers = Annotated[int, typer.Option(min=1, max=64, help="Processes, one core each.")]
JsonFile = Annotated[
    Path | None, typer.Option("--json", help="File for all numbers; - prints them instead of the table.")
]
CpuSeconds = Annotated[
    float, typer.Option(max=86400, help="CPU time of a solve of P_0 at most; P_k has 1 + k times it.")
]
MaxIterations = Annotated[
    int, typer.Option(max=1_000_000, help="Iterations of a solve of P_0 at most; P_k has 1 + k times them.")
]

Save = Annotated[Path | None, typer.Option(help="File for the strict solutions, which `bench chain` takes.")]


class SolveReport:
    """The guesses solved so far, as JSON and as tables."""

    def __init__(self, plan: GuessPlan, n_workers: int) -> None:
        self.plan = plan
        self.solved: list[SolvedGuess] = []
        self.machine = machine()
        self.n_compiled = 0
        #: Why guesses failed, once all are solved.
        self.failures: list[FailureView] = []
        self.settings = {
            "problem_hash": plan.problem.hash,
            "k": plan.problem.k,
            "guesses": plan.n_guesses,
            "law": plan.law,
            "rng_seed": plan.rng_seed,
            **asdict(plan.limits),
            "workers": n_workers,
        }

    def summary(self) -> dict[str, Any]:
        """Return the summary of the guesses."""
        return summary([one.measurement for one in self.solved])

    def content(self, is_partial: bool) -> dict[str, Any]:
        """Return everything as plain data."""
        guesses = sorted(self.solved, key=lambda one: one.number)
        return {
            "command": "bench solve",
            "is_partial": is_partial,
            "machine": self.machine,
            "settings": self.settings,
            "kernels_compiled_while_timing": self.n_compiled,
            "summary": self.summary(),
            "failures": [asdict(one) for one in self.failures],
            "guesses": [{"number": one.number} | asdict(one.measurement) for one in guesses],
        }

    def line(self) -> str:
        """Return the current state in one line."""
        found = self.summary()
        costs, best = found["costs"], found["best_propellant_kg"]
        return (
            f"{len(self.solved)}/{self.plan.n_guesses} guesses: {found['strict']['n']} strict, "
            f"{found['optimal']['n']} optimal, {costs['cpu_seconds']:.0f} CPU s, "
            f"{number(costs['cpu_seconds_per_strict'])} s per strict, best {number(best, 2)} kg"
        )

    def show(self, console: Console, is_partial: bool) -> None:
        """Print tables and what they depend on."""
        found = self.summary()
        if is_partial:
            console.print(f"PARTIAL: interrupted after {len(self.solved)} of {self.plan.n_guesses} guesses")
        console.print(shares(found))
        console.print(distributions(found))
        console.print(failures(found["failed_by"]))
        if self.failures:
            console.print(reasons(self.failures))
        console.print(thrust_line(self.plan.problem, self.solved), highlight=False)
        best, median = found["best_propellant_kg"], found["median_propellant_kg"]
        console.print(f"propellant: best {number(best, 2)} kg, median {number(median, 2)} kg")
        print_facts(console, self.machine | self.settings)
        if self.n_compiled:
            console.print(f"{self.n_compiled} kernels were compiled while timing: run again")
        for fault in found["faults"]:
            console.print(f"fault: {fault}", markup=False)


def solve(
    problem: Annotated[str, typer.Argument(help="Preset or file, with any number of outages.")] = "ppe-drm3",
    guesses: Annotated[int, typer.Option(help="How many guesses are solved.")] = 100,
    law: Annotated[str, typer.Option(help="What they are drawn from.")] = "uniform",
    rng_seed: Annotated[int, typer.Option(min=0, help="Fixes the guesses.")] = 1,
    cpu_seconds: CpuSeconds = DEFAULTS.cpu_seconds,
    max_iterations: MaxIterations = DEFAULTS.max_iterations,
    json_file: JsonFile = None,
    save: Save = None,
    workers: Workers = 1,
) -> None:
    """Solve guesses, verify every result, and show success rates, costs and failures."""
    with user_errors():
        require_folders(json=json_file, save=save)
        limits = SolveSettings(cpu_seconds, max_iterations)
        found = SolveReport(GuessPlan(_flyable(problem), guesses, rng_seed, law, limits), workers)
        for remark in remarks_on(found.plan.problem):
            print_warning(remark)
        ledger = Ledger(json_file, found.content)
    is_partial = run_until_interrupted(found, ledger, workers, warm_up, solve_guesses)
    if not is_partial:
        found.failures = failures_of(found.plan, found.solved)
    if save is not None:
        ordered = sorted(found.solved, key=lambda one: one.number)
        strict = [solution_of(found.plan, one) for one in ordered if one.x is not None]
        write_solutions(save, found.plan.problem, strict)
    if not ledger.close(is_partial):
        found.show(Console(width=110), is_partial)
    if is_partial:
        raise typer.Exit(130)


Seeds = Annotated[
    Path | None,
    typer.Option(help="File of `bench solve --save`; without it, solutions of P_0 are found first."),
]
Cases = Annotated[str | None, typer.Option(help="Cases like S(1|0)@24,S(3|0)@12-24-40.")]
Group = Annotated[str | None, typer.Option(help="Groups of cases: s1, s2, s3, s3from2, s12, s49.")]
MappingName = Annotated[str, typer.Option(help="Mappings, separated by commas.")]
Limit = Annotated[int | None, typer.Option(min=1, help="Take at most so many seeds.")]
SaveSeeds = Annotated[Path | None, typer.Option(help="File for the strict solutions.")]
#: Seeds that are found where none are given.
N_SEEDS = 20


class ChainReport:
    """The seeds mapped so far, as JSON and as tables."""

    def __init__(self, plan: ChainPlan, n_workers: int) -> None:
        self.plan = plan
        self.solved: list[SolvedLink] = []
        self.n_planned = n_links(plan)
        self.machine = machine()
        self.n_compiled = 0
        self.settings = {
            "family": plan.reference.family,
            "seeds": len(plan.seeds),
            "duration_days": plan.duration_days,
            **asdict(plan.limits),
            "workers": n_workers,
        }

    def content(self, is_partial: bool) -> dict[str, Any]:
        """Return everything as plain data."""
        return {
            "command": "bench chain",
            "is_partial": is_partial,
            "machine": self.machine,
            "settings": self.settings,
            "kernels_compiled_while_timing": self.n_compiled,
            "groups": by_group(self.plan, self.solved),
            "cases": by_case(self.plan, self.solved),
            "solves": [as_fields(one) for one in self.solved],
        }

    def line(self) -> str:
        """Return the current state in one line."""
        n_strict = sum(one.measurement.strict for one in self.solved)
        spent = sum(one.measurement.cpu_seconds for one in self.solved)
        last = self.solved[-1]
        return (
            f"{len(self.solved)}/{self.n_planned} seeds mapped: {n_strict} strict, {spent:.0f} CPU s; last "
            f"{last.link.case.name} {last.link.mapping} {last.measurement.failure or 'strict'}"
        )

    def show(self, console: Console, is_partial: bool) -> None:
        """Print tables and what they depend on."""
        if is_partial:
            console.print(f"PARTIAL: interrupted after {len(self.solved)} of at most {self.n_planned} solves")
        console.print(chains(by_case(self.plan, self.solved), "case"))
        groups = by_group(self.plan, self.solved)
        console.print(chains(groups, "group"))
        print_facts(console, self.machine | self.settings)
        if self.n_compiled:
            console.print(f"{self.n_compiled} kernels were compiled while timing: run again")
        for fault in sorted({fault for group in groups for fault in group["faults"]}):
            console.print(f"fault: {fault}", markup=False)


def chain(
    seeds: Seeds = None,
    cases: Cases = None,
    group: Group = None,
    mapping: MappingName = "continued,aligned,reference",
    limit: Limit = None,
    duration_days: Annotated[float, typer.Option(help="How long every outage lasts.")] = 1.0,
    cpu_seconds: CpuSeconds = DEFAULTS.cpu_seconds,
    max_iterations: MaxIterations = DEFAULTS.max_iterations,
    json_file: JsonFile = None,
    save: SaveSeeds = None,
    save_seeds: Annotated[Path | None, typer.Option(help="File for the seeds that were found.")] = None,
    problem: Annotated[str, typer.Option(help="Preset or file that seeds are found for.")] = "ppe-drm3",
    law: Annotated[str, typer.Option(help="What their guesses are drawn from.")] = "uniform",
    rng_seed: Annotated[int, typer.Option(min=0, help="Fixes these guesses.")] = 1,
    workers: Workers = 1,
) -> None:
    """Map seeds to problems with outages, solve, verify every result, and show success rates and costs."""
    with user_errors():
        require_folders(json=json_file, save=save, save_seeds=save_seeds)
        limits = SolveSettings(cpu_seconds, max_iterations)
        wanted = _selected_cases(cases, group)
        mappings = tuple(part.strip() for part in mapping.split(","))
        check_mappings(mappings)
        if seeds is not None:
            given = tuple(distinct(read_solutions(seeds))[:limit])
        else:
            search = GuessPlan(_flyable(problem), 100 * N_SEEDS, rng_seed, law, limits)
            given = _find_seeds(search, limit or N_SEEDS, workers, save_seeds)
        found = ChainReport(ChainPlan(given, wanted, mappings, duration_days, limits), workers)
        ledger = Ledger(json_file, found.content)
    is_partial = run_until_interrupted(found, ledger, workers, warm_up_links, solve_links)
    if save is not None:
        strict = [solution_of_link(found.plan, one) for one in found.solved if one.x is not None]
        write_solutions(save, found.plan.reference, strict)
    if not ledger.close(is_partial):
        found.show(Console(width=150), is_partial)
    if is_partial:
        raise typer.Exit(130)


def _selected_cases(cases: str | None, group: str | None) -> tuple[Case, ...]:
    listed = parse_cases(cases) if cases else []
    if group or not cases:
        listed += group_cases(group or ",".join(DEFAULT_GROUPS))
    return tuple(listed)


def _find_seeds(search: GuessPlan, n: int, n_workers: int, save_seeds: Path | None) -> tuple[Solution, ...]:
    """Find so many distinct solutions, and save them if asked; an interruption ends the command."""
    progress = Progress()
    with process_pool(n_workers) as pool:
        try:
            found = load_seeds(pool, search, n, progress.show)
        finally:
            progress.end()
    if save_seeds is not None:
        write_solutions(save_seeds, search.problem, found)
    return tuple(found)


bench = typer.Typer(help="Measure the numerics on this machine.", no_args_is_help=True)
bench.command()(solve)
bench.command()(chain)

RngSeed = Annotated[int, typer.Option(min=0, help="Fixes the points.")]


@bench.callback()
def _group() -> None:
    """Measure the numerics on this machine."""


@bench.command()
def evaluate(
    rng_seed: RngSeed = 1,
    points: Annotated[int, typer.Option(min=3, help="Points of the box.")] = 20,
    repeats: Annotated[int, typer.Option(min=1, help="Repetitions, of which the least time counts.")] = 7,
    as_json: Json = False,
) -> None:
    """Time defects and their Jacobian for k = 0, 1, 3, 12 and N = 50, 100, beside SciPy."""
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


@bench.command()
def oracles(
    case: Annotated[list[str] | None, typer.Option(help="One of the cases; again for more.")] = None,
    guesses: Annotated[int, typer.Option(min=1, help="Uniform guesses of each case.")] = 20,
    rng_seed: RngSeed = 1,
    as_json: Json = False,
) -> None:
    """Solve published problems, and show what is found beside their published values."""
    from workers.measure_oracles import cases, run_cases

    if unknown := [name for name in case or () if name not in cases()]:
        raise typer.BadParameter(f"expected some of {', '.join(cases())}, got {', '.join(unknown)}")
    with threadpool_limits(1), tempfile.TemporaryDirectory(prefix="coastarc-") as folder:
        results = [asdict(one) for one in run_cases(case or [], Path(folder), guesses, rng_seed)]
    settings = {"guesses": guesses, "rng_seed": rng_seed}
    if as_json:
        typer.echo(json.dumps({"machine": machine(), "settings": settings, "rows": results}, indent=2))
        return
    listed = terminal.table("case", "N", "strict", "of the best", "best", "published", "CPU s a guess")
    for row in results:
        best = number(row["best"], 6 if row["unit"] != "kg" else 3)
        counts = str(row["n_segments"]), f"{row['n_strict']}/{row['n_guesses']}", str(row["n_best"])
        seconds = f"{row['cpu_seconds_per_guess']:.2f}"
        listed.add_row(row["id"], *counts, best, f"{row['published']:.6g}", seconds)
    console = Console(width=120)
    console.print(listed)
    print_facts(console, machine() | settings)
