"""The work of a benchmark: jobs of one solve each, as campaigns run them, on one process or on two.

What is measured is therefore what a campaign pays: `core.solve` or `core.solve_seed` inside `run_job`, by the
processor time of its thread.  Verification is timed apart.  Compilation and the making of tables happen in a
first job of every process, which counts nothing.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numba

from core.nlp import SolveSettings
from core.problem import Problem
from core.transcription import DEFAULT_LEGS
from workers.executor import Executor, Ticket
from workers.job import Address, HopJob, HopLaws, Job, JobOutcome, MapJob, Settings

#: Iterations of a first job: enough to pass through what a solve calls.
WARMING_ITERATIONS = 12
#: How long to wait for news before looking at the keyboard again [s].
PATIENCE_S = 0.5
# Uncounted jobs have tickets below zero.
_WARMING = -1


def guess_job(problem: Problem, number: int, rng_seed: int, law: str, limits: SolveSettings) -> HopJob:
    """Return the solve of one guess; its address alone fixes its numbers, so any worker draws the same."""
    return HopJob(
        problem=problem.model_dump(mode="json"),
        rng_seed=rng_seed,
        address=Address(search=0, chain=number),
        n_hops=1,
        laws=HopLaws(guess_law=law),
        settings=_settings(limits),
    )


def seed_job(
    problem: Problem,
    seed_problem: Problem,
    x: tuple[float, ...],
    mapping: str,
    number: int,
    limits: SolveSettings,
) -> MapJob:
    """Return the solve of one seed."""
    return MapJob(
        problem=problem.model_dump(mode="json"),
        rng_seed=0,
        address=Address(search=0, chain=number),
        seed_id=str(number),
        seed_problem=seed_problem.model_dump(mode="json"),
        seed_x=x,
        mapping=mapping,
        settings=_settings(limits),
    )


def _settings(limits: SolveSettings) -> Settings:
    return Settings(cpu_seconds=limits.cpu_seconds, max_iterations=limits.max_iterations, n_legs=DEFAULT_LEGS)


def warm(executor: Executor, jobs: Iterable[Job]) -> None:
    """Run jobs with few iterations on every process, so that nothing is compiled while the clock runs."""
    for job in jobs:
        brief = job.settings.model_copy(update={"max_iterations": WARMING_ITERATIONS})
        brief_job = job.model_copy(update={"settings": brief})
        for place in range(executor.capacity()):
            executor.submit(Ticket(_WARMING - place, 1), brief_job)
        left = executor.capacity()
        while left:
            left -= len(executor.finished(PATIENCE_S))


def outcomes(executor: Executor, jobs: Iterable[tuple[int, Job]]) -> Iterator[tuple[int, JobOutcome]]:
    """Yield the outcome of every numbered job as it ends; numbers must differ."""
    waiting = iter(jobs)
    running, is_drained = 0, False
    while running or not is_drained:
        while running < executor.capacity() and not is_drained:
            numbered = next(waiting, None)
            if numbered is None:
                is_drained = True
            else:
                executor.submit(Ticket(numbered[0], 1), numbered[1])
                running += 1
        for finished in executor.finished(PATIENCE_S) if running else ():
            running -= 1
            yield finished.ticket.job_id, finished.outcome


def n_compiled_kernels() -> int:
    """Return how many compiled kernels the disk holds for this code: more after a run, if it compiled."""
    folder = Path(numba.config.CACHE_DIR)  # type: ignore[attr-defined]
    return sum(1 for _ in folder.rglob("*.nbc"))
