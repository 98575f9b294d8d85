"""Solutions as points of a picture: so many that a page can draw them, and none that matters left out."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import ColumnElement, Row, and_, func, or_, select
from sqlalchemy.orm import Session

from service.db.tables import ProblemRow, SearchRow, SolutionRow, SolveRow
from service.schemas.solution import PointsView
from service.store.filter import Filter, Wanted

#: Solutions that a search surely has in the picture, though others have thousands.
OF_EACH_SEARCH = 20
#: Points of a front that others are held against in SQL.
ON_FRONT = 50
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


class _Point(NamedTuple):
    id: str
    strategy: str
    k: int
    cpu_seconds: float
    strict: bool
    #: In the order of AXES.
    values: tuple[float, ...]


def list_points(session: Session, wanted: Filter, most: int) -> PointsView:
    """Return the solutions of a filter or, if they are more than `most`, a sample of them.

    The sample holds the extremes of every axis, the front of delta-v and time of flight, and some of each
    search; the rest are those whose hashes are least, which is a choice at random that new solutions keep.
    """
    asked = Wanted(session, wanted)
    n = session.scalar(select(func.count(SolutionRow.id)).where(*asked.conditions())) or 0
    ids = _all(session, asked) if n <= most else _sample(session, asked, most)
    return _view(n, _points(session, asked, sorted(ids)))


def front(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return which pairs no other one beats in both numbers, in order of the first."""
    order = np.lexsort((second, first))
    best = np.minimum.accumulate(second[order])
    on_front: NDArray[np.int64] = order[np.r_[True, best[1:] < best[:-1]][: len(order)]]
    return on_front


def _all(session: Session, asked: Wanted) -> Sequence[str]:
    return session.scalars(select(SolutionRow.id).where(*asked.conditions())).all()


def _sample(session: Session, asked: Wanted, most: int) -> list[str]:
    query = select(SolutionRow.id, *_columns()).where(*asked.conditions())
    # Unless it is left to sort by an expression, SQLite follows the ids and reads the long rows.
    drawn = session.execute(query.order_by(SolutionRow.id.concat("")).limit(most)).all()
    # What stands out among all does so beside the drawn ones, too; there are few such, in one pass.
    rows = [*drawn, *session.execute(query.where(_stands_out(_values(drawn))))]
    values = _values(rows)
    places = [*front(values[:, 0], values[:, 1]), *values.argmin(axis=0), *values.argmax(axis=0)]
    needed = [rows[place][0] for place in places] + _of_searches(session, asked)
    # Each at its first place, so that a cut takes from the end.
    return list(dict.fromkeys([*needed, *(row[0] for row in drawn)]))[:most]


def _stands_out(values: NDArray[np.float64]) -> ColumnElement[bool]:
    """Return whether no point beats a solution in delta-v and time of flight, or whether it is an extreme."""
    delta_v, flight, *_ = _columns()
    best = values[front(values[:, 0], values[:, 1])[:ON_FRONT], :2].tolist()
    is_unbeaten = and_(*(or_(delta_v < first, flight < second) for first, second in best))
    ends = zip(_columns(), values.min(axis=0).tolist(), values.max(axis=0).tolist(), strict=True)
    return or_(is_unbeaten, *(or_(column < least, column > most) for column, least, most in ends))


def _columns() -> list[Any]:
    return [getattr(SolutionRow, name) for name in AXES]


def _values(rows: Sequence[Row[Any]]) -> NDArray[np.float64]:
    return np.array([row[1:] for row in rows], dtype=np.float64).reshape(-1, len(AXES))


def _of_searches(session: Session, asked: Wanted) -> list[str]:
    """Return those of the first ones of each search that the filter admits."""
    first = select(SolveRow.solution_id).where(SolveRow.paper == True).limit(OF_EACH_SEARCH)  # noqa: E712
    searches = asked.searches(session)
    found = {key for search in searches for key in session.scalars(first.where(SolveRow.search_id == search))}
    ids = sorted(key for key in found if key is not None)
    query = select(SolutionRow.id).where(*asked.conditions())
    return [key for some in _parts(ids) for key in session.scalars(query.where(SolutionRow.id.in_(some)))]


def _points(session: Session, asked: Wanted, ids: Sequence[str]) -> list[_Point]:
    told = SolutionRow.id, SearchRow.strategy, ProblemRow.k, SolveRow.cpu_seconds, SolutionRow.strict
    query = (
        select(*told, *_columns())
        .select_from(SolutionRow)
        .join(SolveRow, SolveRow.id == asked.first_solve())
        .join(SearchRow, SearchRow.id == SolveRow.search_id)
        .join(ProblemRow, ProblemRow.hash == SolutionRow.problem_hash)
    )
    found = {
        row[0]: _Point(row[0], row[1], row[2], row[3], row[4], tuple(row[5:]))
        for some in _parts(ids)
        for row in session.execute(query.where(SolutionRow.id.in_(some)))
    }
    return [found[key] for key in ids]


def _parts(ids: Sequence[str]) -> Iterator[Sequence[str]]:
    for start in range(0, len(ids), AT_ONCE):
        yield ids[start : start + AT_ONCE]


def _view(n: int, points: Sequence[_Point]) -> PointsView:
    names = sorted({point.strategy for point in points})
    place = {name: i for i, name in enumerate(names)}
    values = np.array([point.values for point in points], dtype=np.float64).reshape(-1, len(AXES))
    columns: dict[str, Any] = {
        name: np.round(values[:, i], decimals).tolist() for i, (name, decimals) in enumerate(AXES.items())
    }
    return PointsView(
        n=n,
        front=front(values[:, 0], values[:, 1]).tolist(),
        strategies=names,
        id=[point.id for point in points],
        strategy=[place[point.strategy] for point in points],
        k=[point.k for point in points],
        strict=[point.strict for point in points],
        cpu_seconds=[round(point.cpu_seconds, 3) for point in points],
        **columns,
    )
