"""The seeds of a search or a problem with their mappings, as a preview.

What was found for a problem, and for those that differ from it in one outage, is told here too.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from typing import Any, NamedTuple

from pydantic import ValidationError
from sqlalchemy import bindparam, func, select
from sqlalchemy.orm import Session

from core.analysis.similarity import features
from core.problem import Problem, ProblemError, hashes_of, problem_from, validation_message
from service import scheduler
from service.db.tables import (
    CampaignRow,
    CaseRow,
    JobRow,
    ProblemRow,
    SearchRow,
    SolutionRow,
    SolveRow,
    shared_columns,
)
from service.scheduler import Candidate, PlannedJob
from service.schemas.problem import BestSolution, ProblemFamily, Relative
from service.schemas.solution import SeedPage
from service.spec import Spec, SpecError
from service.spec.search_spec import SearchSpec
from service.spec.spec import SeedChoices
from service.store.cache import search_spec, spec_of
from service.store.errors import StoreError, UnknownRowError
from service.store.planning import candidates, n_candidates

#: Pairs of a seed and a mapping in one answer, at most.
MOST_PAIRS = 200
#: Seeds of a problem, where none are asked for in particular.
USUAL_LIMIT = 50


def seeds_of_search(session: Session, campaign_id: int, name: str, wanted: SeedChoices) -> SeedPage:
    """Return what would seed a search of a campaign, and the jobs that it has planned for that."""
    own = (SearchRow.campaign_id == campaign_id) & (SearchRow.name == name)
    row, campaign = session.scalar(select(SearchRow).where(own)), session.get(CampaignRow, campaign_id)
    if campaign is None:
        raise UnknownRowError("campaign", campaign_id)
    if row is None:
        raise UnknownRowError("search", f"{name} of campaign {campaign_id}", "none of this name")
    fields = search_spec(campaign, row).model_dump(by_alias=True, exclude_unset=True)
    if "seeds" not in fields:
        raise StoreError(f"search {name}: expected S(k|k'), which takes seeds, got {row.strategy}")
    search = wanted.applied(fields)
    assert search.seeds is not None
    spec, number = spec_of(campaign), n_candidates(session, row, search)
    wanted_seeds = min(number, search.seeds.limit or number)
    some = candidates(session, campaign, row, search, min(wanted_seeds, MOST_PAIRS + 1))
    page = _page(session, spec, search, some, number, row.id)
    if len(some) >= wanted_seeds or len(page.items) >= min(MOST_PAIRS, search.guesses or MOST_PAIRS):
        return page
    # Seeds that fit no case gave no pair, so those that come later are wanted as well.
    return _page(session, spec, search, candidates(session, campaign, row, search), number, row.id)


def seeds_of_problem(
    session: Session,
    problem_hash: str,
    outages: Sequence[tuple[int, float]] | None,
    seed_k: int | None,
    wanted: SeedChoices,
) -> SeedPage:
    """Return the solutions of the whole archive that would seed a problem, or one of other outages."""
    row = session.get(ProblemRow, problem_hash)
    if row is None:
        raise UnknownRowError("problem", problem_hash)
    try:
        problem = problem_from(row.definition)
        problem = problem if outages is None else problem.with_outages(outages)
    except ProblemError as error:
        raise SpecError(str(error)) from error
    if problem.k == 0:
        raise StoreError("problem: expected outages, since seeds are mapped to more of them, got none")
    fields = {
        "id": "target",
        "strategy": f"S({problem.k}|{seed_k or 0})",
        "outages": problem.model_dump(mode="json")["outages"],
        "seeds": {"from": "archive", "campaign": "archive", "any_duration": True},
    }
    search = replace(wanted, limit=wanted.limit or USUAL_LIMIT).applied(fields)
    spec = _alone(problem, search)
    ks = range(problem.k) if seed_k is None else [seed_k]
    found = _of_family(session, problem, ks, search)
    return _page(session, spec, search, found, len(found))


def _alone(problem: Problem, search: SearchSpec) -> Spec:
    """Return a specification with nothing but a search."""
    reference = problem.with_outages(()).model_dump(mode="json")
    fields = {"campaign": {"name": "archive", "rng_seed": 0}, "problem": reference, "search": [search]}
    try:
        return Spec.model_validate(fields)
    except ValidationError as error:
        raise SpecError(validation_message("seeds", error, Spec)) from error


def _of_family(session: Session, problem: Problem, ks: Sequence[int], search: SearchSpec) -> list[Candidate]:
    """Return the solutions of all problems that differ from one in their outages alone."""
    assert search.seeds is not None
    kin = select(ProblemRow).where(ProblemRow.k.in_(ks), ProblemRow.n_segments == problem.n_segments)
    wanted = _without_outages(problem.model_dump(mode="json"))
    family = {
        row.hash: _outages(row.definition)
        for row in session.scalars(kin)
        if _without_outages(row.definition) == wanted
    }
    is_good = SolutionRow.strict if search.seeds.tolerance == "strict" else SolutionRow.paper
    query = select(
        SolutionRow.id, SolutionRow.problem_hash, SolutionRow.delta_v_km_s, SolutionRow.time_of_flight_days
    ).where(SolutionRow.problem_hash.in_(list(family)), is_good)
    is_diverse = search.seeds.order == "diversity"
    return [
        # In order of hash where the order leaves it open: no rule may look at who came first.
        Candidate(
            solution_id,
            (0, solution_id, 0),
            family[problem_hash],
            delta_v,
            time_of_flight,
            features(problem, session.get_one(SolutionRow, solution_id).x) if is_diverse else None,
        )
        for solution_id, problem_hash, delta_v, time_of_flight in session.execute(query)
    ]


def _without_outages(definition: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in definition.items() if name != "outages"}


def _outages(definition: dict[str, Any]) -> tuple[tuple[int, float], ...]:
    return tuple((outage["segment"], outage["duration_days"]) for outage in definition["outages"])


def _page(
    session: Session,
    spec: Spec,
    search: SearchSpec,
    found: list[Candidate],
    number: int,
    search_id: int | None = None,
) -> SeedPage:
    seeds = scheduler.chosen(search, found)
    try:
        planned = islice(_pairs(spec, search, seeds), search.guesses)
        pairs = list(islice(planned, MOST_PAIRS + 1))
    except ValueError as error:
        raise StoreError(f"mapping: {error}") from error
    hashes = hashes_of(spec.problems_of(search))
    known = _planned_jobs(session, search_id, {seed.id for seed, _ in pairs})
    about = _about(session, {seed.id for seed, _ in pairs})
    items = []
    for seed, job in pairs[:MOST_PAIRS]:
        job_id, job_state = known.get((seed.id, job.case, job.mapping or ""), (None, None))
        items.append(
            _of_seed(seed, *about[seed.id])
            | {"problem_hash": hashes[job.case], "outages": _list_seeds(search.outage_sets[job.case])}
            | {"mapping": job.mapping, "job_id": job_id, "job_state": job_state}
        )
    is_cut = len(pairs) > MOST_PAIRS
    return SeedPage.model_validate({"items": items, "n_candidates": number, "is_cut": is_cut})


def _about(session: Session, seed_ids: set[str]) -> dict[str, tuple[str, bool]]:
    """Return the problem of each seed, and whether it is strict."""
    query = select(SolutionRow.id, SolutionRow.problem_hash, SolutionRow.strict)
    found = session.execute(query.where(SolutionRow.id.in_(seed_ids)))
    return {solution_id: (problem_hash, is_strict) for solution_id, problem_hash, is_strict in found}


def _of_seed(seed: Candidate, problem_hash: str, is_strict: bool) -> dict[str, Any]:
    return {
        "seed_id": seed.id,
        "seed_problem_hash": problem_hash,
        "seed_outages": _list_seeds(seed.outages),
        "delta_v_km_s": seed.delta_v_km_s,
        "time_of_flight_days": seed.time_of_flight_days,
        "strict": is_strict,
    }


def _pairs(
    spec: Spec, search: SearchSpec, seeds: Sequence[Candidate]
) -> Iterator[tuple[Candidate, PlannedJob]]:
    for number, seed in enumerate(seeds):
        for job in scheduler.map_jobs(spec, search, seed, number):
            yield seed, job


def _planned_jobs(
    session: Session, search_id: int | None, seed_ids: set[str]
) -> dict[tuple[str, int, str], tuple[int, str]]:
    """Return the map jobs of a search (id, state) by seed, case and mapping."""
    if search_id is None:
        return {}
    query = select(JobRow.seed_id, JobRow.case_index, JobRow.mapping, JobRow.id, JobRow.state).where(
        JobRow.search_id == search_id,
        JobRow.kind == "map",
        # The chain is the hash of the seed: so the address is looked up.
        JobRow.chain.in_(seed_ids),
        JobRow.case_index.in_(select(CaseRow.position).where(CaseRow.search_id == search_id)),
    )
    return {
        (seed or "", case, mapping or ""): (job_id, state)
        for seed, case, mapping, job_id, state in session.execute(query)
    }


def _list_seeds(case: Sequence[tuple[int, float]]) -> list[dict[str, Any]]:
    return [{"segment": segment, "duration_days": duration} for segment, duration in case]


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
FROM_SOLUTION = shared_columns(SolutionRow, BestSolution)


class _Kin(NamedTuple):
    """A problem of the family, and the one outage by which it differs."""

    row: ProblemRow
    outage: tuple[int, float]


def family(session: Session, problem_hash: str) -> ProblemFamily:
    """Return the best solutions of a problem, and its relatives with one outage more or less."""
    own = session.get(ProblemRow, problem_hash)
    if own is None:
        raise UnknownRowError("problem", problem_hash)
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
