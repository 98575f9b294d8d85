"""Planning and fair scheduling of jobs.

Pure functions that the store calls.  Every rule depends on the specification and on what is stored, never on
the number of workers or on who came first, except that budgets in core seconds or solutions end a search at a
moment that does.  Searches share the workers by priority first, then by weight: the one whose jobs have had
the least processor time per weight is served next.  The order of jobs depends on this, what they find does
not.  How long leases last, and how long a failed job waits for its next attempt, is set here too.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, TypeVar

from core.problem import Problem
from core.search.settings import REFINED, expand_mapping
from service.spec import Spec
from service.spec.search_spec import SearchSpec
from service.spec.spec import Case, targets

if TYPE_CHECKING:
    from core.analysis.similarity import Array

T = TypeVar("T")

#: Chains that are kept ready in the queue, however large the budget is.
CHAINS_AHEAD = 256
#: Failures (crash, lost) after which a job is given up.
MAX_FAILURES = 3


@dataclass(frozen=True, slots=True)
class PlannedJob:
    """A job that is to exist; with its search this is its whole address."""

    kind: str
    chain: int
    n_hops: int
    case: int = 0
    hop: int = 0
    seed_id: str | None = None
    mapping: str | None = None


@dataclass(frozen=True, slots=True)
class Progress:
    """What a search has done so far."""

    #: Chains that were ever planned.
    n_chains: int
    #: Up to `CHAINS_AHEAD`, beyond which it makes no difference.
    n_queued: int
    #: Up to 1.
    n_running: int
    cpu_seconds: float
    n_solutions: int
    #: Whether the search that gives the seeds has ended; True for one that needs none.
    source_has_ended: bool = True

    @property
    def n_open(self) -> int:
        """Jobs that have not ended."""
        return self.n_queued + self.n_running


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A solution that may become a seed, with its place in its own search."""

    id: str
    #: (case, chain, hop) of the first solve that found it.
    address: tuple[int, str, int]
    #: The outages (segment, duration [d]) that it survives.
    outages: Case
    delta_v_km_s: float
    time_of_flight_days: float
    #: Its reference in scaled variables, where an order asks for diversity [-].
    features: "Array | None" = None


def is_exhausted(search: SearchSpec, progress: Progress) -> bool:
    """Return whether a budget in core seconds or solutions is used up."""
    is_late = search.core_seconds is not None and progress.cpu_seconds >= search.core_seconds
    return is_late or (search.solutions is not None and progress.n_solutions >= search.solutions)


def next_chains(search: SearchSpec, progress: Progress) -> list[PlannedJob]:
    """Return the chains that S(k) needs now, numbered on from the last; none for S(k|k')."""
    if search.seed_k is not None or is_exhausted(search, progress):
        return []
    wanted = range(progress.n_chains, progress.n_chains + max(0, CHAINS_AHEAD - progress.n_queued))
    n_cases = len(search.outage_sets)
    return [
        PlannedJob("hop", chain, n_hops, case=chain % n_cases)
        for chain in wanted
        if (n_hops := _hops_of(search, *divmod(chain, n_cases)))
    ]


def _hops_of(search: SearchSpec, number: int, case: int) -> int:
    """Divide a budget in guesses over the cases and their chains; the last one gets what is left."""
    if search.guesses is None:
        return search.hops
    share, rest = divmod(search.guesses, len(search.outage_sets))
    return max(0, min(search.hops, share + (case < rest) - number * search.hops))


def map_jobs(spec: Spec, search: SearchSpec, seed: Candidate, number: int = 0) -> list[PlannedJob]:
    """Return the jobs that map a seed: the chain is its hash read as an integer, the hop counts mappings."""
    jobs: list[PlannedJob] = []
    for case in targets(search, seed.outages, number):
        texts = _concrete(spec.problem, search.mapping, tuple(seed.outages), search.outage_sets[case])
        jobs += [
            PlannedJob("map", int(seed.id, 16), 1, case, hop, seed.id, text) for hop, text in enumerate(texts)
        ]
    return jobs


@lru_cache(maxsize=4096)
def _concrete(problem: Problem, mappings: tuple[str, ...], seed_case: Case, case: Case) -> tuple[str, ...]:
    """Return the mappings of a seed to a case, which are the same for each seed of its problem."""
    if REFINED in mappings:
        return mappings
    problems = [problem.with_outages(one) for one in (seed_case, case)]
    texts = [text for mapping in mappings for text in expand_mapping(mapping, *problems)]
    return tuple(dict.fromkeys(texts))


def chosen(search: SearchSpec, candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return the seeds in their order, up to the limit; equal ones stand in order of address."""
    assert search.seeds is not None
    ordered = sorted(candidates, key=lambda candidate: candidate.address)
    if search.seeds.order == "chain":
        # Chains take turns over the cases, addresses list one case after the other.
        ordered.sort(key=lambda candidate: candidate.address[1:])
    elif search.seeds.order == "delta_v":
        ordered.sort(key=lambda candidate: candidate.delta_v_km_s)
    elif search.seeds.order == "time_of_flight":
        ordered.sort(key=lambda candidate: candidate.time_of_flight_days)
    elif search.seeds.order == "diversity":
        # Imported here, since it needs the numerics and lists of campaigns, which plan nothing, do not.
        import numpy as np

        from core.analysis.similarity import most_diverse

        # The best goes first, then always the one farthest from those before it.
        ordered.sort(key=lambda candidate: candidate.delta_v_km_s)
        features = np.array([candidate.features for candidate in ordered])
        ordered = [ordered[i] for i in most_diverse(features, search.seeds.limit or len(ordered))]
    return ordered[: search.seeds.limit]


def jobs_of_seeds(spec: Spec, search: SearchSpec, candidates: Iterable[Candidate]) -> list[PlannedJob]:
    """Return the jobs of a search that chooses among all its seeds, up to its budget in guesses."""
    seeds = chosen(search, candidates)
    jobs = [job for number, seed in enumerate(seeds) for job in map_jobs(spec, search, seed, number)]
    return jobs[: search.guesses]


def priority(search: SearchSpec) -> int:
    """Return the queue's order: the end of a seed chain first, so that each seed runs all the way down."""
    if search.priority is not None:
        return search.priority
    return -search.k if search.seed_k is not None else 0


def search_state(search: SearchSpec, progress: Progress, new_jobs: Sequence[PlannedJob]) -> str:
    """Return the state of a search that is neither cancelled nor done."""
    if progress.n_open or new_jobs:
        return "active"
    if search.seed_k is not None:
        return "done" if progress.source_has_ended else "waiting"
    return "done"


def n_planned(search: SearchSpec, n_mapped: int) -> int | None:
    """Return how many solves a search will make, as far as that is known."""
    if search.seed_k is not None:
        return n_mapped
    return search.guesses


def after_failure(ending: str, n_failures: int) -> str:
    """Return the next state of a job whose attempt gave no result, counted with this failure."""
    if ending == "cancelled":
        return "queued"
    if ending == "error":
        # The same input would raise again.
        return "dead"
    return "dead" if n_failures >= MAX_FAILURES else "queued"


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
    """Return up to `number` jobs by weighted fair sharing between searches.

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


#: Wait after the first failure and at most; it doubles in between [s].
BACKOFF_S = 1.0
LONGEST_BACKOFF_S = 60.0


@dataclass(frozen=True, slots=True)
class LeaseSettings:
    """Lease timing [s]: a lease outlives two lost heartbeats."""

    lease_s: float = 30.0
    heartbeat_s: float = 10.0
    #: How often expired leases are looked for.
    reap_s: float = 5.0

    def __post_init__(self) -> None:
        """Refuse a timing under which healthy workers would lose their jobs."""
        if not 0 < self.heartbeat_s < self.lease_s or not self.reap_s > 0:
            raise ValueError(
                f"leases: expected 0 < heartbeat_s < lease_s and 0 < reap_s, got heartbeat_s = "
                f"{self.heartbeat_s}, lease_s = {self.lease_s}, reap_s = {self.reap_s}"
            )


def backoff_s(n_failures: int) -> float:
    """Return how long a job waits after so many failures [s]."""
    # Bounded before the power, which would overflow for a job that is requeued for ever.
    return min(BACKOFF_S * 2.0 ** min(n_failures - 1, 30), LONGEST_BACKOFF_S) if n_failures else 0.0
