"""How often, how fast and how well guesses of one problem are solved."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from core.nlp import SolveSettings
from core.problem import Problem
from core.search import GUESS_LAWS
from workers.bench_jobs import guess_job, outcomes, warm
from workers.bench_measurement import Measurement, measured
from workers.bench_seeds import Solution, distinct
from workers.executor import Executor
from workers.job import HopJob


@dataclass(frozen=True, slots=True)
class GuessPlan:
    """The guesses of one problem that are to be solved."""

    problem: Problem
    n_guesses: int
    rng_seed: int = 1
    law: str = "uniform"
    limits: SolveSettings = field(default_factory=SolveSettings)

    def __post_init__(self) -> None:
        """Refuse what no guess can be drawn from."""
        if self.n_guesses < 1:
            raise ValueError(f"guesses: expected at least 1, got {self.n_guesses}")
        if self.law not in GUESS_LAWS:
            raise ValueError(f"law: expected one of {', '.join(GUESS_LAWS)}, got {self.law!r}")


@dataclass(frozen=True, slots=True)
class SolvedGuess:
    """One guess by its number, from 0, and what its solve measured."""

    number: int
    measurement: Measurement
    #: The decision vector of a strict solution [days, rad, kg].
    x: tuple[float, ...] | None


def warm_up(executor: Executor, plan: GuessPlan) -> None:
    """Let every process compile and load all that it needs, before anything is timed."""
    warm(executor, [_job(plan, 0)])


def solve_guesses(executor: Executor, plan: GuessPlan) -> Iterator[SolvedGuess]:
    """Solve guesses one by one and yield each as it ends; with several processes not always in order."""
    numbered = ((number, _job(plan, number)) for number in range(plan.n_guesses))
    for number, outcome in outcomes(executor, numbered):
        yield SolvedGuess(number, *measured(plan.problem, outcome))


def solution_of(plan: GuessPlan, one: SolvedGuess) -> Solution:
    """Return a strict solution under the number of its guess."""
    assert one.x is not None and one.measurement.propellant_kg is not None
    found = one.measurement
    return Solution(one.number, plan.problem, one.x, one.measurement.propellant_kg, found.is_optimal)


def found_seeds(
    executor: Executor, plan: GuessPlan, n: int, tell: Callable[[str], None] = lambda line: None
) -> list[Solution]:
    """Return the first n distinct solutions in the order of the guesses, whatever the number of processes."""
    warm_up(executor, plan)
    solved: dict[int, SolvedGuess] = {}
    kept: list[Solution] = []
    for one in solve_guesses(executor, plan):
        solved[one.number] = one
        # Up to the first guess that is still being solved, so that a slower one is not passed over.
        is_known = [number in solved for number in range(plan.n_guesses)]
        ready = is_known.index(False) if False in is_known else plan.n_guesses
        known = (solved[number] for number in range(ready))
        kept = distinct(solution_of(plan, guess) for guess in known if guess.x is not None)
        tell(f"{len(solved)} guesses: {len(kept)} of {n} seeds")
        if len(kept) >= n:
            return kept[:n]
    raise ValueError(f"seeds: expected {n} distinct solutions, got {len(kept)} of {plan.n_guesses} guesses")


def _job(plan: GuessPlan, number: int) -> HopJob:
    return guess_job(plan.problem, number, plan.rng_seed, plan.law, plan.limits)
