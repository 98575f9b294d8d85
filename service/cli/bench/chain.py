"""`coastarc bench chain`: what seeds become when outages come, by each mapping."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from core.nlp import SolveSettings
from core.problem import load_problem
from service.bench.machine import machine
from service.cli.bench import tables
from service.cli.bench.session import Ledger, Progress, is_cut_short, opened, require_folders, user_errors
from service.cli.bench.solve import DEFAULTS, CpuSeconds, JsonFile, MaxIterations, Workers
from workers.measure_chains import (
    ChainPlan,
    SolvedLink,
    as_fields,
    by_case,
    by_group,
    check_mappings,
    n_links,
    solution_of,
    solve_links,
    warm_up,
)
from workers.measure_solves import (
    DEFAULT_GROUPS,
    Case,
    GuessPlan,
    Solution,
    distinct,
    found_seeds,
    grouped_cases,
    parsed_cases,
    read_solutions,
    write_solutions,
)

Seeds = Annotated[
    Path | None,
    typer.Option(help="File of `bench solve --save`; without it, solutions of P_0 are found first."),
]
Cases = Annotated[str | None, typer.Option(help="Cases like S(1|0)@24,S(3|0)@12-24-40.")]
Group = Annotated[str | None, typer.Option(help="Groups of cases: s1, s2, s3, s3from2, s12, s49.")]
Mapping = Annotated[str, typer.Option(help="Mappings, separated by commas.")]
Limit = Annotated[int | None, typer.Option(min=1, help="Take at most so many seeds.")]
Save = Annotated[Path | None, typer.Option(help="File for the strict solutions.")]
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
        """Return the state of things in one line."""
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
        console.print(tables.chains(by_case(self.plan, self.solved), "case"))
        groups = by_group(self.plan, self.solved)
        console.print(tables.chains(groups, "group"))
        tables.print_facts(console, self.machine | self.settings)
        if self.n_compiled:
            console.print(f"{self.n_compiled} kernels were compiled while the clock ran: run again")
        for fault in sorted({fault for group in groups for fault in group["faults"]}):
            console.print(f"fault: {fault}", markup=False)


def chain(
    seeds: Seeds = None,
    cases: Cases = None,
    group: Group = None,
    mapping: Mapping = "continued,aligned,reference",
    limit: Limit = None,
    duration_days: Annotated[float, typer.Option(help="How long every outage lasts.")] = 1.0,
    cpu_seconds: CpuSeconds = DEFAULTS.cpu_seconds,
    max_iterations: MaxIterations = DEFAULTS.max_iterations,
    json_file: JsonFile = None,
    save: Save = None,
    save_seeds: Annotated[Path | None, typer.Option(help="File for the seeds that were found.")] = None,
    problem: Annotated[str, typer.Option(help="Preset or file that seeds are found for.")] = "ppe-drm3",
    law: Annotated[str, typer.Option(help="What their guesses are drawn from.")] = "uniform",
    rng_seed: Annotated[int, typer.Option(min=0, help="Fixes these guesses.")] = 1,
    workers: Workers = 1,
) -> None:
    """Map seeds to problems with outages, solve, verify every result, and tell shares, costs and prices."""
    with user_errors():
        require_folders(json=json_file, save=save, save_seeds=save_seeds)
        limits = SolveSettings(cpu_seconds, max_iterations)
        wanted = _wanted(cases, group)
        mappings = tuple(part.strip() for part in mapping.split(","))
        check_mappings(mappings)
        if seeds is not None:
            given = tuple(distinct(read_solutions(seeds))[:limit])
        else:
            search = GuessPlan(load_problem(problem), 100 * N_SEEDS, rng_seed, law, limits)
            given = _regenerated(search, limit or N_SEEDS, workers, save_seeds)
        found = ChainReport(ChainPlan(given, wanted, mappings, duration_days, limits), workers)
        ledger = Ledger(json_file, found.content)
    is_partial = is_cut_short(found, ledger, workers, warm_up, solve_links)
    if save is not None:
        strict = [solution_of(found.plan, one) for one in found.solved if one.x is not None]
        write_solutions(save, found.plan.reference, strict)
    if not ledger.close(is_partial):
        found.show(Console(width=150), is_partial)
    if is_partial:
        raise typer.Exit(130)


def _wanted(cases: str | None, group: str | None) -> tuple[Case, ...]:
    listed = parsed_cases(cases) if cases else []
    if group or not cases:
        listed += grouped_cases(group or ",".join(DEFAULT_GROUPS))
    return tuple(listed)


def _regenerated(search: GuessPlan, n: int, n_workers: int, save_seeds: Path | None) -> tuple[Solution, ...]:
    """Find so many distinct solutions, and save them if asked; an interruption here ends the command."""
    progress = Progress()
    with opened(n_workers) as pool:
        try:
            found = found_seeds(pool, search, n, progress.show)
        finally:
            progress.end()
    if save_seeds is not None:
        write_solutions(save_seeds, search.problem, found)
    return tuple(found)
