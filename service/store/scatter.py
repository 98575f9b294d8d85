"""Scatter data of solutions: downsampled, with the Pareto front kept.

Clusters of the best solutions of a filter: the same trajectory found repeatedly.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import ColumnElement, Row, and_, func, or_, select
from sqlalchemy.orm import Session

from core.analysis.similarity import clusters, feature_rows
from core.problem import Problem, problem_from
from service.db.tables import ProblemRow, SearchRow, SolutionRow, SolveRow
from service.schemas.solution import ClusterPage, ClusterView, Filter, PointsView
from service.store.cache import definition_of
from service.store.filters import Begin, Order, Wanted, ids_of_page

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
    return _points_view(n, _points(session, asked, sorted(ids)))


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


def _points_view(n: int, points: Sequence[_Point]) -> PointsView:
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


#: Solutions that are compared: a second of work at most.
COMPARED = 2000
#: Ids that one query names.
CLUSTERS_AT_ONCE = 500


class _Member(NamedTuple):
    id: str
    problem_hash: str
    x: tuple[float, ...]
    delta_v_km_s: float
    time_of_flight_days: float
    strategy: str


def list_clusters(session: Session, wanted: Filter, threshold: float, limit: int) -> ClusterPage:
    """Return the clusters of the solutions with the least delta-v, those of other problems apart."""
    asked = Wanted(session, wanted)
    n = session.scalar(select(func.count()).select_from(SolutionRow).where(*asked.conditions())) or 0
    ids, _ = ids_of_page(session, wanted, Order("delta_v_km_s"), Begin(), COMPARED)
    found: list[ClusterView] = []
    for problem, members in _families(session, _members(session, asked, ids)):
        found += _clusters(problem, members, threshold)
    found.sort(key=lambda cluster: cluster.min_delta_v_km_s)
    return ClusterPage(
        items=found[:limit], n_clusters=len(found), n=n, n_compared=len(ids), threshold=threshold
    )


def _clusters(problem: Problem, members: list[_Member], threshold: float) -> Iterator[ClusterView]:
    rows = feature_rows(problem, [member.x for member in members])
    # In order of delta-v, so that the first of each cluster, which represents it, is its best.
    of_member = clusters(rows, threshold)
    for number in range(of_member.max() + 1):
        places = np.flatnonzero(of_member == number)
        distances = np.linalg.norm(rows[places] - rows[places[0]], axis=1)
        yield _cluster_view([members[place] for place in places], distances)


def _cluster_view(members: list[_Member], distances: NDArray[np.float64]) -> ClusterView:
    days = [member.time_of_flight_days for member in members]
    others = distances[1:]
    return ClusterView(
        best_id=members[0].id,
        size=len(members),
        strategies=dict(sorted(Counter(member.strategy for member in members).items())),
        min_delta_v_km_s=members[0].delta_v_km_s,
        max_delta_v_km_s=members[-1].delta_v_km_s,
        min_time_of_flight_days=min(days),
        max_time_of_flight_days=max(days),
        mean_distance=float(others.mean()) if len(others) else 0.0,
        max_distance=float(others.max()) if len(others) else 0.0,
    )


def _members(session: Session, asked: Wanted, ids: list[str]) -> list[_Member]:
    query = (
        select(
            SolutionRow.id,
            SolutionRow.problem_hash,
            SolutionRow.x,
            SolutionRow.delta_v_km_s,
            SolutionRow.time_of_flight_days,
            SearchRow.strategy,
        )
        .select_from(SolutionRow)
        .join(SolveRow, SolveRow.id == asked.first_solve())
        .join(SearchRow, SearchRow.id == SolveRow.search_id)
    )
    found: dict[str, _Member] = {}
    for start in range(0, len(ids), CLUSTERS_AT_ONCE):
        for row in session.execute(query.where(SolutionRow.id.in_(ids[start : start + CLUSTERS_AT_ONCE]))):
            found[row[0]] = _Member(*row)
    return [found[key] for key in ids]


def _families(session: Session, members: list[_Member]) -> Iterator[tuple[Problem, list[_Member]]]:
    """Yield members apart whose references differ in segments or bounds: they have no distance."""
    family_of: dict[str, str] = {}
    families: dict[str, list[_Member]] = {}
    for member in members:
        key = member.problem_hash
        if key not in family_of:
            family_of[key] = _family(definition_of(session, key))
        families.setdefault(family_of[key], []).append(member)
    for found in families.values():
        yield problem_from(definition_of(session, found[0].problem_hash)), found


def _family(definition: dict[str, Any]) -> str:
    # All but the outages, which change nothing in what a reference is made of.
    return repr({name: value for name, value in definition.items() if name != "outages"})
