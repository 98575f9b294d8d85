"""`coastarc bench solve`: how often, how fast and how well guesses are solved."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from core.nlp import SolveSettings
from core.problem import load_problem
from service.bench.machine import machine
from service.cli.bench import tables
from service.cli.bench.session import Ledger, is_cut_short, require_folders, user_errors
from workers.measure_solves import (
    GuessPlan,
    SolvedGuess,
    solution_of,
    solve_guesses,
    summary,
    warm_up,
    write_solutions,
)

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
        """Return what the guesses come to."""
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
            "guesses": [{"number": one.number} | asdict(one.measurement) for one in guesses],
        }

    def line(self) -> str:
        """Return the state of things in one line."""
        found = self.summary()
        costs, best = found["costs"], found["best_propellant_kg"]
        return (
            f"{len(self.solved)}/{self.plan.n_guesses} guesses: {found['strict']['n']} strict, "
            f"{found['optimal']['n']} optimal, {costs['cpu_seconds']:.0f} CPU s, "
            f"{tables.number(costs['cpu_seconds_per_strict'])} s per strict, best {tables.number(best, 2)} kg"
        )

    def show(self, console: Console, is_partial: bool) -> None:
        """Print tables and what they depend on."""
        found = self.summary()
        if is_partial:
            console.print(f"PARTIAL: interrupted after {len(self.solved)} of {self.plan.n_guesses} guesses")
        console.print(tables.shares(found))
        console.print(tables.distributions(found))
        console.print(tables.failures(found["failed_by"]))
        best, median = found["best_propellant_kg"], found["median_propellant_kg"]
        console.print(f"propellant: best {tables.number(best, 2)} kg, median {tables.number(median, 2)} kg")
        tables.print_facts(console, self.machine | self.settings)
        if self.n_compiled:
            console.print(f"{self.n_compiled} kernels were compiled while the clock ran: run again")
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
    """Solve guesses, verify every result, and tell shares, costs and why the others failed."""
    with user_errors():
        require_folders(json=json_file, save=save)
        limits = SolveSettings(cpu_seconds, max_iterations)
        found = SolveReport(GuessPlan(load_problem(problem), guesses, rng_seed, law, limits), workers)
        ledger = Ledger(json_file, found.content)
    is_partial = is_cut_short(found, ledger, workers, warm_up, solve_guesses)
    if save is not None:
        ordered = sorted(found.solved, key=lambda one: one.number)
        strict = [solution_of(found.plan, one) for one in ordered if one.x is not None]
        write_solutions(save, found.plan.problem, strict)
    if not ledger.close(is_partial):
        found.show(Console(width=110), is_partial)
    if is_partial:
        raise typer.Exit(130)
