"""Solutions as points of a picture: so many that a page can draw them, and none that matters left out."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import select
from sqlalchemy.orm import Session

from service.api.solution_schemas import PointsView
from service.db.tables import ProblemRow, SearchRow, SolutionRow, SolveRow
from service.store.filter import Filter, Wanted

#: Solutions that a search surely has in the picture, though others have thousands.
OF_EACH_SEARCH = 20
#: What the axes of a picture show, with the decimals that it can show.
AXES = {
    "delta_v_km_s": 6,
    "time_of_flight_days": 4,
    "initial_coast_days": 4,
    "shooting_days": 4,
    "final_coast_days": 4,
    "propellant_kg": 3,
}
#: Ids that one query names.
AT_ONCE = 1000


def list_points(session: Session, wanted: Filter, most: int) -> PointsView:
    """Return the solutions of a filter or, if they are more than `most`, a sample of them.

    The sample holds the extremes of every axis, the front of delta-v and time of flight, and some of each
    search; the rest are those whose hashes are least, which is a choice at random that new solutions keep.
    """
    asked = Wanted(session, wanted)
    columns = [getattr(SolutionRow, name) for name in AXES]
    # Never the vectors: an index holds all that is read here.
    query = select(SolutionRow.id, *columns).where(*asked.conditions()).order_by(SolutionRow.id)
    rows = session.execute(query).all()
    ids = [row[0] for row in rows]
    values = np.array([row[1:] for row in rows], dtype=np.float64).reshape(-1, len(AXES))
    on_front = front(values[:, 0], values[:, 1])
    kept = np.arange(len(ids))
    if len(ids) > most:
        first = _first_of_searches(session, asked, ids)
        kept = sample(values, np.union1d(on_front, first), most)
    places = {int(place): i for i, place in enumerate(kept)}
    return PointsView(
        n=len(ids),
        front=[places[int(place)] for place in on_front if int(place) in places],
        id=[ids[place] for place in kept],
        **{
            name: np.round(values[kept, i], decimals).tolist()
            for i, (name, decimals) in enumerate(AXES.items())
        },
        **_origins(session, asked, [ids[place] for place in kept]),
    )


def front(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return which pairs no other one beats in both numbers, in order of the first."""
    order = np.lexsort((second, first))
    best = np.minimum.accumulate(second[order])
    is_better = np.r_[True, best[1:] < best[:-1]][: len(order)]
    return order[is_better]


def sample(values: NDArray[np.float64], needed: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """Return at most so many rows, in order: the extremes of each column, the needed, then the first ones."""
    extremes = np.r_[values.argmin(axis=0), values.argmax(axis=0)]
    chosen = np.r_[extremes, needed, np.arange(len(values))]
    # Each at its first place, so that a cut takes from the end.
    _, where = np.unique(chosen, return_index=True)
    return np.sort(chosen[np.sort(where)[:most]])


def _first_of_searches(session: Session, asked: Wanted, ids: Sequence[str]) -> NDArray[np.int64]:
    place = {key: i for i, key in enumerate(ids)}
    found: list[int] = []
    for search in asked.searches(session):
        query = (
            select(SolveRow.solution_id)
            .where(SolveRow.search_id == search, SolveRow.paper == True)  # noqa: E712
            .limit(OF_EACH_SEARCH)
        )
        found += [place[key] for key in session.scalars(query) if key in place]
    return np.array(found, dtype=np.int64)


def _origins(session: Session, asked: Wanted, ids: Sequence[str]) -> dict[str, Any]:
    """Return what the search and the solve of each solution say."""
    query = (
        select(SolutionRow.id, SearchRow.strategy, ProblemRow.k, SolveRow.cpu_seconds, SolutionRow.strict)
        .select_from(SolutionRow)
        .join(SolveRow, SolveRow.id == asked.first_solve())
        .join(SearchRow, SearchRow.id == SolveRow.search_id)
        .join(ProblemRow, ProblemRow.hash == SolutionRow.problem_hash)
    )
    found = {
        row[0]: row[1:]
        for start in range(0, len(ids), AT_ONCE)
        for row in session.execute(query.where(SolutionRow.id.in_(ids[start : start + AT_ONCE])))
    }
    strategies, ks, seconds, are_strict = zip(*(found[key] for key in ids), strict=True) if ids else ([],) * 4
    names = sorted(set(strategies))
    return {
        "strategies": names,
        "strategy": [names.index(name) for name in strategies],
        "k": ks,
        "cpu_seconds": [round(value, 3) for value in seconds],
        "strict": are_strict,
    }
