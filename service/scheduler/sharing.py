"""Whose turn it is: searches share the workers by priority first, then by weight.

What is shared is processor time: the search whose jobs have had the least of it per weight is served next.
The order of jobs depends on this, what they find does not.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")

#: Processor time that a solve of a search is taken to need before any has ended [s].
FIRST_COST_S = 1.0


@dataclass(slots=True)
class Share:
    """A search with jobs in the queue, and how much it has had."""

    search_id: int
    #: Of its campaign, then its own; lower goes first.
    priority: tuple[int, int]
    weight: float
    #: Processor time per weight that its jobs have had [s].
    served_s: float
    #: Solves that run now, and what one needs on average [s].
    n_running: int
    cost_s: float

    @property
    def turn(self) -> tuple[tuple[int, int], float, int]:
        """Its place in the order; the least goes first."""
        running = self.n_running * self.cost_s / self.weight
        return self.priority, self.served_s + running, self.search_id


def in_turn(shares: list[Share], take: Callable[[int], tuple[T, int] | None], number: int) -> list[T]:
    """Return up to `number` jobs, each from the search whose turn it is.

    Parameters
    ----------
    shares : list of Share
        The searches; what they take is added to them.
    take : callable
        Returns the next job of a search and its number of solves, or None when it has no more.
    number : int
        Jobs wanted.
    """
    taken: list[T] = []
    waiting = {share.search_id: share for share in shares}
    while waiting and len(taken) < number:
        share = min(waiting.values(), key=lambda one: one.turn)
        job = take(share.search_id)
        if job is None:
            del waiting[share.search_id]
        else:
            taken.append(job[0])
            share.n_running += job[1]
    return taken


def mean_cost_s(cpu_seconds: float, n_solves: int) -> float:
    """Return what a solve of a search needs on average [s]."""
    # A mean of nothing would let a search that has just begun take every worker at once.
    return max(cpu_seconds / n_solves, 1e-3) if n_solves else FIRST_COST_S
