"""What a campaign has found so far, kept in memory and brought up to date solve by solve.

A chronicle holds counts, sums, the moments of improvement and the delta-v of all solutions; it is made from
the rows of `service.store.chronicles`, in the order in which they were stored.
"""

from array import array
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.store.bins import OutcomeBins
from service.store.outcomes import OUTCOMES

#: The rate is that of the last minutes, counted in slots [s].
RATE_WINDOW_S, SLOT_S = 300.0, 5.0


@dataclass(frozen=True, slots=True)
class SearchFacts:
    """What a search is, as far as its solves are grouped by it."""

    id: int
    campaign_id: int
    strategy: str
    k: int
    seed_k: int | None
    #: The one that all its outages last [d], 0 without outages, None where they differ.
    duration_days: float | None


class Solves(NamedTuple):
    """Solves of one search in order of id, one array per column."""

    id: NDArray[np.int64]
    outcome: NDArray[np.int64]
    created_at: NDArray[np.float64]
    cpu_seconds: NDArray[np.float64]


class Found(NamedTuple):
    """A solution that a solve found."""

    solution_id: str
    strict: bool
    delta_v_km_s: float
    created_at: float
    #: Processor time of its strategy up to and with that solve [s].
    spent_s: float


class Step(NamedTuple):
    """A moment at which the best delta-v of strict solutions improved."""

    #: Seconds since 1970, or processor seconds.
    at: float
    delta_v_km_s: float
    solution_id: str


@dataclass(slots=True)
class StrategyChronicle:
    """The solves of one strategy, and when its best improved."""

    k: int
    seed_k: int | None
    outcomes: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(OUTCOMES), dtype=np.int64))
    cpu_seconds: float = 0.0
    steps: list[Step] = field(default_factory=list)


class Chronicle:
    """The solves of one campaign."""

    def __init__(self, created_at: float) -> None:
        self.bins = OutcomeBins(created_at)
        self.strategies: dict[str, StrategyChronicle] = {}
        #: Improvements over all strategies, against time.
        self.steps: list[Step] = []
        #: Of different strict solutions, by strategy and duration of the outages.
        self.delta_v: defaultdict[tuple[str, float | None], array[float]] = defaultdict(lambda: array("d"))
        #: Seeds that were tried, by (k', k).
        self.seeds: defaultdict[tuple[int, int], set[str]] = defaultdict(set)
        self._known: set[str] = set()
        self._recent: Counter[int] = Counter()

    @property
    def n_solves(self) -> int:
        """How many solves it has taken in."""
        return sum(int(one.outcomes.sum()) for one in self.strategies.values())

    def add_solves(self, search: SearchFacts, solves: Solves) -> NDArray[np.float64]:
        """Count solves of a search; return what its strategy had spent after each of them [s]."""
        strategy = self.strategies.setdefault(search.strategy, StrategyChronicle(search.k, search.seed_k))
        strategy.outcomes += np.bincount(solves.outcome, minlength=len(OUTCOMES))
        spent = strategy.cpu_seconds + np.cumsum(solves.cpu_seconds)
        strategy.cpu_seconds = float(spent[-1])
        self.bins.add(solves.outcome, solves.created_at)
        slots, counts = np.unique(solves.created_at // SLOT_S, return_counts=True)
        self._recent.update(dict(zip(slots.astype(int).tolist(), counts.tolist(), strict=True)))
        return spent

    def add_solution(self, search: SearchFacts, found: Found) -> None:
        """Take in a solution, and say when it was better than all before it."""
        if found.solution_id not in self._known:
            self._known.add(found.solution_id)
            if found.strict:
                self.delta_v[search.strategy, search.duration_days].append(found.delta_v_km_s)
        if found.strict:
            self._improve(self.strategies[search.strategy].steps, found, found.spent_s)
            self._improve(self.steps, found, found.created_at)

    def _improve(self, steps: list[Step], found: Found, at: float) -> None:
        if not steps or found.delta_v_km_s < steps[-1].delta_v_km_s:
            steps.append(Step(at, found.delta_v_km_s, found.solution_id))

    def add_seed(self, search: SearchFacts, seed_id: str) -> None:
        """Remember that a search has tried a seed."""
        if search.seed_k is not None:
            self.seeds[search.seed_k, search.k].add(seed_id)

    def rate_per_min(self, now: float) -> float:
        """Return how many solves a minute there were of late."""
        first = (now - RATE_WINDOW_S) // SLOT_S
        for slot in [slot for slot in self._recent if slot < first]:
            del self._recent[slot]
        window = min(RATE_WINDOW_S, max(now - self.bins.start, 1.0))
        return 60.0 * sum(self._recent.values()) / window
