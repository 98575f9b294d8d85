"""The history of a campaign: improvements, outcomes over time, seeds, delta-v.

A history holds counts, sums, moments of improvement and the delta-v of all solutions.  It is cached in memory
and brought up to date with every question: a solve is stored once and never changed, and the one writer
stores them in order of id, so each is read once in the life of a process.  After a start there may be a
million to read: a coordinator then reads ahead, piece by piece; a question meanwhile reads one piece more,
and its answer says how far that was.  Outcomes over time are counted in a bounded number of bins, which grow
wider as a campaign grows older; each solve counts once, by the verification where there is one.
"""

import threading
import time
from array import array
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import bindparam, case, func, select
from sqlalchemy.orm import Session

from service import scheduler
from service.db.engine import Database
from service.db.tables import CampaignRow, JobRow, SearchRow, SolutionRow, SolveRow
from service.schemas.campaign import (
    BoxView,
    CampaignCard,
    ChainView,
    HistoryView,
    OutcomeBinsView,
    Outcomes,
    StepView,
    StrategyView,
)
from service.store.cache import search_spec
from service.store.campaigns import (
    SLOT_S,
    Numbers,
    campaigns_in_numbers,
    eta_seconds,
    first_slot,
    item_fields,
    rate_per_min,
    ratio_view,
)
from service.store.errors import UnknownRowError
from service.store.filters import look_up_campaign
from service.store.statistics import sum_counts

T = TypeVar("T")

#: Feasible at the strict tolerance, at the paper's alone, or not, and then why not.
OUTCOMES = ("strict", "paper", "infeasible", "timeout", "numerical")


def outcome_number() -> Any:
    """Return the place of a solve's outcome in `OUTCOMES` as an SQL expression."""
    return case(
        (SolveRow.strict, 0),
        (SolveRow.paper, 1),
        (SolveRow.ending == "timeout", 3),
        (SolveRow.ending == "numerical", 4),
        else_=2,
    )


#: Each a multiple of the one before, so that bins merge into wider ones [s].
WIDTHS_S = (1, 5, 15, 30, 60, 300, 900, 1800, 3600, 7200, 21600, 43200, 86400)
MOST_BINS = 120


class OutcomeBins:
    """How many solves ended how, from the start of a campaign on."""

    def __init__(self, start: float) -> None:
        self.start = start
        self.width_s: int = WIDTHS_S[0]
        #: One row per outcome, one column per bin.
        self.counts = np.zeros((len(OUTCOMES), 0), dtype=np.int64)

    def add(self, outcomes: NDArray[np.int64], times: NDArray[np.float64]) -> None:
        """Count solves by the numbers of their outcomes and the times at which they were stored."""
        after = np.maximum(times - self.start, 0.0)
        self._widen_to(float(after.max()))
        bins = (after // self.width_s).astype(np.int64)
        n_bins = max(self.counts.shape[1], int(bins.max()) + 1)
        counts = np.zeros((len(OUTCOMES), n_bins), dtype=np.int64)
        counts[:, : self.counts.shape[1]] = self.counts
        np.add.at(counts, (outcomes, bins), 1)
        self.counts = counts

    def _widen_to(self, latest: float) -> None:
        while latest >= MOST_BINS * self.width_s:
            wider = next((width for width in WIDTHS_S if width > self.width_s), 2 * self.width_s)
            self._merge(wider // self.width_s)
            self.width_s = wider

    def _merge(self, n_merged: int) -> None:
        n_bins = self.counts.shape[1]
        missing = -n_bins % n_merged
        padded = np.pad(self.counts, ((0, 0), (0, missing)))
        self.counts = padded.reshape(len(OUTCOMES), -1, n_merged).sum(axis=2)

    def lists(self) -> dict[str, Any]:
        """Return the counts by name of outcome."""
        return {name: row.tolist() for name, row in zip(OUTCOMES, self.counts, strict=True)}


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
class StrategyHistory:
    """The solves of one strategy, and when its best improved."""

    k: int
    seed_k: int | None
    outcomes: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(OUTCOMES), dtype=np.int64))
    cpu_seconds: float = 0.0
    steps: list[Step] = field(default_factory=list)


class History:
    """The solves of one campaign."""

    def __init__(self, created_at: float) -> None:
        self.bins = OutcomeBins(created_at)
        self.strategies: dict[str, StrategyHistory] = {}
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
        strategy = self.strategies.setdefault(search.strategy, StrategyHistory(search.k, search.seed_k))
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
        first = first_slot(now)
        for slot in [slot for slot in self._recent if slot < first]:
            del self._recent[slot]
        return rate_per_min(self._recent.total(), self.bins.start, now)


#: Solves read at once, and how long one question reads [s].
CHUNK, PATIENCE_S = 10_000, 0.1

_NEW = SolveRow.id > bindparam("after")
_INSIDE = _NEW & (SolveRow.id <= bindparam("last"))
_SOLVES = (
    select(SolveRow.id, SolveRow.search_id, outcome_number(), SolveRow.created_at, SolveRow.cpu_seconds)
    .where(_NEW)
    .order_by(SolveRow.id)
    .limit(CHUNK)
)
_SOLUTIONS = (
    select(
        SolveRow.id,
        SolveRow.search_id,
        SolutionRow.delta_v_km_s,
        SolutionRow.id,
        SolveRow.strict,
        SolveRow.created_at,
    )
    .join(SolutionRow, SolutionRow.id == SolveRow.solution_id)
    .where(_INSIDE)
    .order_by(SolveRow.id)
)
_SEEDS = (
    select(SolveRow.search_id, JobRow.seed_id)
    .join(JobRow, JobRow.id == SolveRow.job_id)
    .where(_INSIDE, JobRow.seed_id.is_not(None))
    .distinct()
)


class HistoryCache:
    """The histories of one archive."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._lock = threading.Lock()
        self._last_solve = 0
        self._searches: dict[int, SearchFacts] = {}
        self._histories: dict[int, History] = {}

    def ask(self, question: Callable[[Session, "HistoryCache"], T]) -> T:
        """Bring the histories up to date, as far as there is time, and ask something about them."""
        with self._lock, self._database.read() as session:
            self._read_on(session)
            return question(session, self)

    def read_on(self) -> bool:
        """Read a piece; return whether more may be left."""
        with self._lock, self._database.read() as session:
            return self._read_chunk(session) == CHUNK

    def history(self, campaign: CampaignRow) -> History:
        """Return the history of a campaign."""
        return self._histories.setdefault(campaign.id, History(campaign.created_at))

    def _read_on(self, session: Session) -> None:
        end = time.monotonic() + PATIENCE_S
        while self._read_chunk(session) == CHUNK and time.monotonic() < end:
            pass

    def _read_chunk(self, session: Session) -> int:
        # Past the session, whose own loading takes as long as all the rest.
        connection = session.connection()
        rows = connection.execute(_SOLVES, {"after": self._last_solve}).all()
        if not rows:
            return 0
        # Column by column: rows are no tuples, and numpy is slow with them.
        columns = np.array([*zip(*rows, strict=True)], dtype=np.float64).T
        inside = {"after": self._last_solve, "last": int(columns[-1, 0])}
        # All is at hand before any of it is counted: what fails is read again, and counted once.
        solutions = connection.execute(_SOLUTIONS, inside).all()
        seeds = connection.execute(_SEEDS, inside).all()
        self._learn_searches(session, set(columns[:, 1].astype(int).tolist()))
        self._last_solve = inside["last"]
        spent = self._add_solves(columns)
        for solve_id, search_id, delta_v, solution_id, strict, at in solutions:
            search = self._searches[search_id]
            found = Found(solution_id, strict, delta_v, at, spent[solve_id])
            self._histories[search.campaign_id].add_solution(search, found)
        for search_id, seed_id in seeds:
            search = self._searches[search_id]
            self._histories[search.campaign_id].add_seed(search, seed_id or "")
        return len(rows)

    def _add_solves(self, columns: Any) -> dict[int, float]:
        """Count solves; return what the strategy of each had spent after it, by id of the solve."""
        spent: dict[int, float] = {}
        for strategy in sorted({self._key(search_id) for search_id in np.unique(columns[:, 1])}):
            ids = [one.id for one in self._searches.values() if (one.campaign_id, one.strategy) == strategy]
            own = columns[np.isin(columns[:, 1], ids)]
            solves = Solves(own[:, 0].astype(np.int64), own[:, 2].astype(np.int64), own[:, 3], own[:, 4])
            after = self._histories[strategy[0]].add_solves(self._searches[ids[0]], solves)
            spent.update(zip(solves.id.tolist(), after.tolist(), strict=True))
        return spent

    def _key(self, search_id: float) -> tuple[int, str]:
        search = self._searches[int(search_id)]
        return search.campaign_id, search.strategy

    def _learn_searches(self, session: Session, ids: set[int]) -> None:
        unknown = ids - self._searches.keys()
        if not unknown:
            return
        query = (
            select(SearchRow, CampaignRow)
            .join(CampaignRow, CampaignRow.id == SearchRow.campaign_id)
            .where(SearchRow.id.in_(unknown))
        )
        for row, campaign in session.execute(query):
            self._searches[row.id] = _facts(row, campaign)
            self.history(campaign)


def _facts(row: SearchRow, campaign: CampaignRow) -> SearchFacts:
    spec = search_spec(campaign, row)
    durations = spec.durations or {0.0}
    duration = durations.pop() if len(durations) == 1 else None
    return SearchFacts(row.id, campaign.id, row.strategy, spec.k, spec.seed_k, duration)


#: Steps of one strategy, delta-v of one box and of all boxes that are sent at most.
MOST_STEPS, MOST_OF_BOX, MOST_OF_BOXES = 200, 120, 3000
SECONDS_PER_HOUR = 3600.0


def campaign_history(session: Session, histories: HistoryCache, campaign_id: int) -> HistoryView:
    """Return the history of a campaign."""
    campaign = session.get(CampaignRow, campaign_id)
    if campaign is None:
        raise UnknownRowError("campaign", campaign_id)
    history = histories.history(campaign)
    n_solves = select(func.sum(SearchRow.n_solves)).where(SearchRow.campaign_id == campaign_id)
    strategies = sorted(history.strategies.items(), key=lambda item: _place(item[1]))
    return HistoryView(
        campaign_id=campaign_id,
        n_solves=session.scalar(n_solves) or 0,
        n_read=history.n_solves,
        outcomes=OutcomeBinsView(width_seconds=history.bins.width_s, **history.bins.lists()),
        strategies=[_strategy(name, one) for name, one in strategies],
        chains=_chains(history),
        delta_v=_boxes(history),
    )


def _place(one: StrategyHistory) -> tuple[int, int]:
    return one.k, -1 if one.seed_k is None else one.seed_k


def _strategy(name: str, one: StrategyHistory) -> StrategyView:
    n_solves, n_strict = int(one.outcomes.sum()), int(one.outcomes[0])
    n_paper = n_strict + int(one.outcomes[1])
    return StrategyView(
        strategy=name,
        k=one.k,
        seed_k=one.seed_k,
        n_solves=n_solves,
        n_paper=n_paper,
        n_strict=n_strict,
        paper_ratio=ratio_view(n_paper, n_solves),
        strict_ratio=ratio_view(n_strict, n_solves),
        core_hours=one.cpu_seconds / SECONDS_PER_HOUR,
        steps=[
            StepView(core_hours=at / SECONDS_PER_HOUR, delta_v_km_s=delta_v, solution_id=solution_id)
            for at, delta_v, solution_id in _evenly(one.steps, MOST_STEPS)
        ],
    )


def _evenly(steps: Sequence[Step], most: int) -> list[Step]:
    return [steps[place] for place in _places(len(steps), most)]


def _places(n: int, most: int) -> list[int]:
    """Return all places of a list, or so many evenly, the first and the last among them."""
    if n <= most:
        return list(range(n))
    places: list[int] = np.linspace(0, n - 1, most).round().astype(int).tolist()
    return places


def _chains(history: History) -> list[ChainView]:
    groups: defaultdict[tuple[int | None, int], list[StrategyHistory]] = defaultdict(list)
    for one in history.strategies.values():
        groups[one.seed_k, one.k].append(one)
    order = sorted(groups, key=lambda pair: (-1 if pair[0] is None else pair[0], pair[1]))
    return [_chain(history, seed_k, k, groups[seed_k, k]) for seed_k, k in order]


def _chain(history: History, seed_k: int | None, k: int, group: Sequence[StrategyHistory]) -> ChainView:
    n_solves = sum(int(one.outcomes.sum()) for one in group)
    n_strict = sum(int(one.outcomes[0]) for one in group)
    seconds = sum(one.cpu_seconds for one in group)
    return ChainView(
        seed_k=seed_k,
        k=k,
        n_seeds=0 if seed_k is None else len(history.seeds[seed_k, k]),
        n_solves=n_solves,
        n_strict=n_strict,
        strict_ratio=ratio_view(n_strict, n_solves),
        core_seconds_per_strict=seconds / n_strict if n_strict else None,
    )


def _boxes(history: History) -> list[BoxView]:
    most = min(MOST_OF_BOX, MOST_OF_BOXES // max(1, len(history.delta_v)))
    groups = [
        (history.strategies[name], name, days, values) for (name, days), values in history.delta_v.items()
    ]
    groups.sort(key=lambda group: (_place(group[0]), group[2] is None, group[2] or 0.0))
    return [_box(one.k, name, days, np.sort(values), most) for one, name, days, values in groups]


def _box(k: int, strategy: str, duration_days: float | None, ordered: Any, most: int) -> BoxView:
    least, lower, median, upper, greatest = np.quantile(ordered, (0.0, 0.25, 0.5, 0.75, 1.0)).tolist()
    return BoxView(
        strategy=strategy,
        k=k,
        duration_days=duration_days,
        n_solutions=len(ordered),
        least_km_s=least,
        lower_quartile_km_s=lower,
        median_km_s=median,
        upper_quartile_km_s=upper,
        greatest_km_s=greatest,
        sample_km_s=[ordered[place] for place in _places(len(ordered), most)],
    )


#: Moments of a sparkline.
N_MOMENTS = 60


def campaign_cards(
    session: Session, known: HistoryCache, now: float, name_or_id: str | None = None
) -> list[CampaignCard]:
    """Return the campaigns, the newest first, or the one of an id or name if there is one."""
    only = None
    if name_or_id is not None:
        only = look_up_campaign(session, name_or_id)
        if only is None:
            return []
    return [
        _card(campaign, numbers, known.history(campaign), now)
        for campaign, numbers in campaigns_in_numbers(session, only)
    ]


def _card(campaign: CampaignRow, numbers: Sequence[Numbers], history: History, now: float) -> CampaignCard:
    end = campaign.finished_at or now
    planned = [scheduler.n_planned(search_spec(campaign, one.row), one.row.n_planned) for one in numbers]
    rate = history.rate_per_min(end)
    return CampaignCard(
        **item_fields(campaign, numbers),
        outcomes=_outcomes(numbers),
        n_guesses_planned=_sum(planned),
        n_searches=len(numbers),
        strategies=list(dict.fromkeys(one.row.strategy for one in numbers)),
        rate_per_min=rate,
        eta_seconds=eta_seconds(campaign, numbers, planned, rate),
        elapsed_seconds=end - campaign.created_at,
        cpu_seconds=sum(one.row.cpu_seconds for one in numbers),
        sparkline_km_s=sparkline(history.steps, campaign.created_at, end),
        n_read=history.n_solves,
    )


def _outcomes(numbers: Sequence[Numbers]) -> Outcomes:
    """Return how solves ended, from what is counted as they are stored."""
    levels = sum_counts(one.tallies.get("level", {}) for one in numbers)
    endings = sum_counts(one.tallies.get("solve", {}) for one in numbers)
    n_strict, n_paper = levels.get("strict", 0), levels.get("paper", 0)
    odd = {name: endings.get(name, 0) for name in ("timeout", "numerical")}
    n_rest = sum(endings.values()) - n_paper - sum(odd.values())
    return Outcomes(strict=n_strict, paper=n_paper - n_strict, infeasible=n_rest, **odd)


def _sum(planned: Sequence[int | None]) -> int | None:
    known = [number for number in planned if number is not None]
    return sum(known) if len(known) == len(planned) else None


def sparkline(steps: Sequence[Step], begin: float, end: float) -> list[float | None]:
    """Return the best delta-v at moments from begin to end, None before the first solution."""
    if not steps:
        return []
    moments = np.linspace(begin, end, N_MOMENTS)
    places = np.searchsorted([step.at for step in steps], moments, side="right") - 1
    # What was stored in the very moment of the end is known then.
    places[-1] = len(steps) - 1
    return [steps[place].delta_v_km_s if place >= 0 else None for place in places]
