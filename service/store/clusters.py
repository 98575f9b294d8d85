"""Clusters of the best solutions of a filter: which ones are the same flight, found again."""

from collections import Counter
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from core.analysis.distinct import clusters, feature_rows
from core.problem import Problem, problem_from
from service.db.tables import SearchRow, SolutionRow, SolveRow
from service.schemas.solution import ClusterPage, ClusterView
from service.store.filter import Filter, Wanted
from service.store.page import Begin, Order, ids_of_page
from service.store.specs import definition_of

#: Solutions that are compared: a second of work at most.
COMPARED = 2000
#: Ids that one query names.
AT_ONCE = 500


class _Member(NamedTuple):
    id: str
    problem_hash: str
    x: NDArray[np.float64]
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
        yield _view([members[place] for place in places], distances)


def _view(members: list[_Member], distances: NDArray[np.float64]) -> ClusterView:
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
    for start in range(0, len(ids), AT_ONCE):
        for row in session.execute(query.where(SolutionRow.id.in_(ids[start : start + AT_ONCE]))):
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
