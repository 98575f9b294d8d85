"""What was found for a problem, and for the problems that differ from it in one outage."""

from collections import Counter
from typing import Any, NamedTuple

from sqlalchemy import bindparam, func, select
from sqlalchemy.orm import Session

from service.db.tables import ProblemRow, SearchRow, SolutionRow, SolveRow
from service.schemas.problem import BestSolution, ProblemFamily, Relative
from service.store.errors import UnknownRow

#: Solutions and relatives that are listed.
MOST_BEST = 10
MOST_RELATIVES = 50

_BEST = (
    select(SolutionRow)
    .where(SolutionRow.problem_hash == bindparam("problem"))
    .order_by(SolutionRow.objective_kg.desc(), SolutionRow.id)
    .limit(bindparam("most"))
)
_N_SOLUTIONS = select(func.count()).where(SolutionRow.problem_hash == bindparam("problem"))
_FINDER = (
    select(SearchRow.campaign_id, SearchRow.name.label("search"), SearchRow.strategy)
    .join(SolveRow, SolveRow.search_id == SearchRow.id)
    .where(SolveRow.solution_id == bindparam("solution"))
    .order_by(SolveRow.id)
    .limit(1)
)
FROM_SOLUTION = (
    "id",
    "objective_kg",
    "propellant_kg",
    "delta_v_km_s",
    "shooting_days",
    "initial_coast_days",
    "time_of_flight_days",
    "strict",
)


class _Kin(NamedTuple):
    """A problem of the family, and the one outage by which it differs."""

    row: ProblemRow
    outage: tuple[int, float]


def family(session: Session, problem_hash: str) -> ProblemFamily:
    """Return the best solutions of a problem, and its relatives with one outage more or less."""
    own = session.get(ProblemRow, problem_hash)
    if own is None:
        raise UnknownRow("problem", problem_hash)
    fewer, more = _relatives(session, own)
    return ProblemFamily(
        n_solutions=_n_solutions(session, problem_hash),
        best=[_best(session, row) for row in _solutions(session, problem_hash, MOST_BEST)],
        fewer=[_relative(session, kin) for kin in fewer[:MOST_RELATIVES]],
        more=[_relative(session, kin) for kin in more[:MOST_RELATIVES]],
        n_fewer=len(fewer),
        n_more=len(more),
    )


def _relatives(session: Session, own: ProblemRow) -> tuple[list[_Kin], list[_Kin]]:
    wanted, case = _without_outages(own.definition), _case(own.definition)
    found: dict[int, list[_Kin]] = {-1: [], 1: []}
    kin = select(ProblemRow).where(
        ProblemRow.k.in_((own.k - 1, own.k + 1)), ProblemRow.n_segments == own.n_segments
    )
    for row in session.scalars(kin):
        smaller, larger = sorted((case, _case(row.definition)), key=len)
        rest = Counter(larger) - Counter(smaller)
        if rest.total() == 1 and _without_outages(row.definition) == wanted:
            found[row.k - own.k].append(_Kin(row, next(iter(rest))))
    for listed in found.values():
        listed.sort(key=lambda kin: (kin.outage, kin.row.hash))
    return found[-1], found[1]


def _case(definition: dict[str, Any]) -> list[tuple[int, float]]:
    return [(outage["segment"], outage["duration_days"]) for outage in definition["outages"]]


def _without_outages(definition: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in definition.items() if name != "outages"}


def _solutions(session: Session, problem_hash: str, most: int) -> list[SolutionRow]:
    return list(session.scalars(_BEST, {"problem": problem_hash, "most": most}))


def _n_solutions(session: Session, problem_hash: str) -> int:
    return session.execute(_N_SOLUTIONS, {"problem": problem_hash}).scalar_one()


def _best(session: Session, row: SolutionRow) -> BestSolution:
    finder = session.execute(_FINDER, {"solution": row.id}).mappings().one()
    return BestSolution(**{name: getattr(row, name) for name in FROM_SOLUTION}, **finder)


def _relative(session: Session, kin: _Kin) -> Relative:
    best = _solutions(session, kin.row.hash, 1)
    return Relative.model_validate(
        {
            "hash": kin.row.hash,
            "k": kin.row.k,
            "outages": kin.row.definition["outages"],
            "outage": {"segment": kin.outage[0], "duration_days": kin.outage[1]},
            "n_solutions": _n_solutions(session, kin.row.hash),
            "best_delta_v_km_s": best[0].delta_v_km_s if best else None,
        }
    )
