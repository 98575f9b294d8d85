"""The chronicles of all campaigns, brought up to date with every question about them.

A solve is stored once and never changed, and the one writer stores them in order of id; so each is read
once in the life of a process, and a page that asks every second costs what is new.  After a start there may
be a million to read: a coordinator then reads ahead, piece by piece; a question meanwhile reads one piece
more, and its answer says how far that was.
"""

import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from sqlalchemy import bindparam, select
from sqlalchemy.orm import Session

from service.db.engine import Database
from service.db.tables import CampaignRow, JobRow, SearchRow, SolutionRow, SolveRow
from service.store.chronicle import Chronicle, Found, SearchFacts, Solves
from service.store.outcomes import outcome_number
from service.store.specs import search_spec

T = TypeVar("T")

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


class Chronicles:
    """The chronicles of one archive."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._lock = threading.Lock()
        self._last_solve = 0
        self._searches: dict[int, SearchFacts] = {}
        self._chronicles: dict[int, Chronicle] = {}

    def ask(self, question: Callable[[Session, "Chronicles"], T]) -> T:
        """Bring the chronicles up to date, as far as there is time, and ask something about them."""
        with self._lock, self._database.read() as session:
            self._read_on(session)
            return question(session, self)

    def read_on(self) -> bool:
        """Read a piece; return whether more may be left."""
        with self._lock, self._database.read() as session:
            return self._read_chunk(session) == CHUNK

    def chronicle(self, campaign: CampaignRow) -> Chronicle:
        """Return the chronicle of a campaign."""
        return self._chronicles.setdefault(campaign.id, Chronicle(campaign.created_at))

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
            self._chronicles[search.campaign_id].add_solution(search, found)
        for search_id, seed_id in seeds:
            search = self._searches[search_id]
            self._chronicles[search.campaign_id].add_seed(search, seed_id or "")
        return len(rows)

    def _add_solves(self, columns: Any) -> dict[int, float]:
        """Count solves; return what the strategy of each had spent after it, by id of the solve."""
        spent: dict[int, float] = {}
        for strategy in sorted({self._key(search_id) for search_id in np.unique(columns[:, 1])}):
            ids = [one.id for one in self._searches.values() if (one.campaign_id, one.strategy) == strategy]
            own = columns[np.isin(columns[:, 1], ids)]
            solves = Solves(own[:, 0].astype(np.int64), own[:, 2].astype(np.int64), own[:, 3], own[:, 4])
            after = self._chronicles[strategy[0]].add_solves(self._searches[ids[0]], solves)
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
            self.chronicle(campaign)


def _facts(row: SearchRow, campaign: CampaignRow) -> SearchFacts:
    spec = search_spec(campaign, row)
    durations = spec.durations or {0.0}
    duration = durations.pop() if len(durations) == 1 else None
    return SearchFacts(row.id, campaign.id, row.strategy, spec.k, spec.seed_k, duration)
