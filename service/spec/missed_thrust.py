"""A missed-thrust analysis as a campaign: which outages are tried on one solution, and in which order.

Each duration is two searches: from the solution itself, and from what the next shorter duration found, since
a recovery leads to that from a slightly longer outage.  All else is that of any campaign.
"""

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

from core.errors import UserError
from core.problem import Problem

#: How an analysis is called, before the beginning of the solution's id.
NAME = "missed-thrust"
#: Iterations of a recovery, at most: what has not closed by then hardly ever does.
MAX_ITERATIONS = 800
#: Where an outage begins, and how long it lasts, unless asked for otherwise: every other segment; days.
USUAL_STRIDE, USUAL_DURATIONS = 2, "0.5,1,2,4,7,10"

_NUMBER = r"\d+(?:\.\d+)?"
_RANGE = re.compile(rf"({_NUMBER}):({_NUMBER}):({_NUMBER})")
_LIST = re.compile(rf"{_NUMBER}(?:,{_NUMBER})*")
_MOST = 400


class GridError(UserError, ValueError):
    """Segments or durations that cannot be tried; the message says why."""


class Grid(NamedTuple):
    """The outages of an analysis: each duration at each segment."""

    segments: tuple[int, ...]
    durations_days: tuple[float, ...]


def grid_of(problem: Problem, segments: str | None = None, durations: str = USUAL_DURATIONS) -> Grid:
    """Return the outages that a user asks for, as START:STOP:STEP or as a list with commas.

    Without segments it is every other one, and those of the problem's own outages.
    """
    last = problem.n_segments - 1
    wanted: Sequence[float] = [*range(1, last + 1, USUAL_STRIDE), *(o.segment for o in problem.outages)]
    if segments is not None:
        wanted = _numbers("segments", segments)
    days, longest = _numbers("durations", durations), problem.bounds.longest_outage_days
    for number in wanted:
        if not 1 <= number <= last or number != int(number):
            raise GridError(f"segments: expected whole numbers in 1..{last}, got {number:g}")
    for number in days:
        if not 0.0 < number <= longest:
            raise GridError(f"durations: expected above 0 to {longest:g} days, got {number:g}")
    return Grid(tuple(sorted({int(number) for number in wanted})), tuple(sorted(set(days))))


def _numbers(name: str, text: str) -> list[float]:
    """Return what a range, its stop included, or a list stands for."""
    compact = text.replace(" ", "")
    if match := _RANGE.fullmatch(compact):
        start, stop, step = (float(part) for part in match.groups())
        if not (step > 0.0 and 0.0 <= (stop - start) / step <= _MOST):
            raise GridError(f"{name}: expected START <= STOP in up to {_MOST} steps, got {text}")
        # Rounded, so that 0.1:0.3:0.1 is what it says; by this formula, as NumPy does it.
        n_steps = int((stop - start) / step + 1e-9)
        return [round((start + step * i) * 1e9) / 1e9 for i in range(n_steps + 1)]
    if _LIST.fullmatch(compact):
        return [float(part) for part in compact.split(",")]
    raise GridError(f"{name}: expected START:STOP:STEP or numbers with commas, got {text!r}")


def analysis_name(solution_id: str) -> str:
    """Return what the analyses of a solution are called."""
    return f"{NAME} {solution_id[:12]}"


def analysis_spec(
    solution_id: str, problem: Problem, grid: Grid, tolerance: str = "strict"
) -> dict[str, Any]:
    """Return the specification of the campaign that analyses a solution of a problem."""
    searches: list[dict[str, Any]] = []
    before = ""
    for place, days in enumerate(grid.durations_days):
        seeds = {"solution": solution_id, "tolerance": tolerance}
        searches.append(_search(f"{days:g}d", "S(1|0)", seeds, grid, days))
        if place:
            seeds = {"from": before, "tolerance": tolerance}
            searches.append(_search(f"{days:g}d-on", "S(1|1)", seeds, grid, days))
        before = searches[-1]["id"]
    return {
        "campaign": {"name": analysis_name(solution_id), "rng_seed": 0},
        "problem": problem.with_outages(()).model_dump(mode="json"),
        "search": searches,
    }


def _search(name: str, strategy: str, seeds: dict[str, Any], grid: Grid, days: float) -> dict[str, Any]:
    return {
        "id": name,
        "strategy": strategy,
        "cases": [[segment] for segment in grid.segments],
        "duration_days": days,
        "seeds": seeds,
        "mapping": "aligned",
        "reference": "frozen",
        "max_iterations": MAX_ITERATIONS,
    }
