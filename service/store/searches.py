"""One search: settings, progress, and hops chain by chain.

Of many chains, whole ones are drawn evenly from all.  Step sizes of adaptive chains are not stored: they are
reconstructed from hop outcomes, from which alone they follow.
"""

from collections.abc import Iterable
from itertools import groupby
from typing import Any, cast

from sqlalchemy import Select, case, func, literal_column, select
from sqlalchemy.orm import Session, aliased

from core.search.settings import HopSettings
from service import scheduler
from service.db.dialect import mixed
from service.db.tables import JobRow, SearchRow, SolutionRow, SolveRow, shared_columns
from service.schemas.answer import CampaignState
from service.schemas.search import (
    BudgetView,
    HopColumns,
    HopsView,
    JobCounts,
    LawsView,
    SearchDetail,
    SearchState,
    SeedOfSearch,
    SeedRules,
)
from service.spec.search_spec import SearchSpec
from service.store.cache import search_spec
from service.store.campaigns import cases_of, get_search_row, numbers_of


def get_search(session: Session, campaign_id: int, name: str) -> SearchDetail:
    """Return a search of a campaign."""
    campaign, row = get_search_row(session, campaign_id, name)
    spec = search_spec(campaign, row)
    (numbers,) = numbers_of(session, SearchRow.id == row.id)
    levels, best = numbers.tallies.get("level", {}), numbers.best
    return SearchDetail(
        campaign_id=campaign.id,
        campaign=campaign.name,
        campaign_state=cast(CampaignState, campaign.state),
        id=row.id,
        name=row.name,
        strategy=row.strategy,
        state=cast(SearchState, row.state),
        priority=row.priority,
        weight=row.weight,
        k=spec.k,
        seed_k=spec.seed_k,
        cases=cases_of(session, row, spec),
        hops=spec.hops,
        budget=BudgetView(guesses=spec.guesses, core_seconds=spec.core_seconds, solutions=spec.solutions),
        laws=None if spec.seeds else _laws(spec),
        seeds=_seed_rules(spec),
        solve_cpu_seconds=spec.cpu_seconds,
        max_iterations=spec.max_iterations,
        jobs=JobCounts(**numbers.jobs),
        n_guesses_planned=scheduler.n_planned(spec, row.n_planned),
        n_solves=row.n_solves,
        cpu_seconds=row.cpu_seconds,
        n_paper=levels.get("paper", 0),
        n_strict=levels.get("strict", 0),
        best_solution_id=best.id if best else None,
        best_delta_v_km_s=best.delta_v_km_s if best else None,
    )


def _laws(spec: SearchSpec) -> LawsView:
    laws = spec.laws
    return LawsView(
        guess_law=laws.guess_law,
        hop_law=laws.hop_law,
        width=laws.width,
        shape=laws.shape,
        adaptive=laws.adaptive,
        width_range=laws.width_range if laws.adaptive else None,
        time_hop_probability=laws.time_hop_probability,
        max_failures=laws.max_failures,
    )


def _seed_rules(spec: SearchSpec) -> SeedRules | None:
    if spec.seeds is None:
        return None
    return SeedRules(**spec.seeds.model_dump(), mapping=list(spec.mapping))


def widths(settings: HopSettings, solves: Iterable[tuple[str | None, float | None]]) -> list[float | None]:
    """Return the width of each solve of a chain, from its first on; None where its guess was drawn afresh.

    Each solve is given by its move and its violation, which is None where it was not finite.
    """
    found: list[float | None] = []
    width, is_hopping = settings.width, False
    for move, violation in solves:
        found.append(width if is_hopping else None)
        if settings.adaptive and is_hopping:
            width = settings.next_width(width, move == "accepted")
        if move == "accepted":
            is_hopping = violation is not None
        elif move == "restarted":
            width, is_hopping = settings.width, False
    return found


#: Columns that an answer takes over as they are.
FROM_SOLVE = shared_columns(SolveRow, HopColumns, but=("solution_id", "cpu_seconds"))
_VERDICT = case((SolveRow.strict, "strict"), (SolveRow.paper, "paper"))
_SOLVES = (
    select(
        *(getattr(SolveRow, name) for name in FROM_SOLVE),
        SolveRow.cpu_seconds,
        SolveRow.solution_id,
        JobRow.case_index.label("case"),
        JobRow.chain,
        JobRow.hop.label("first_hop"),
        JobRow.seed_id,
        JobRow.mapping,
        _VERDICT.label("verdict"),
        SolutionRow.delta_v_km_s,
    )
    .join(JobRow, JobRow.id == SolveRow.job_id)
    .outerjoin(SolutionRow, SolutionRow.id == SolveRow.solution_id)
    .order_by(JobRow.case_index, JobRow.chain, SolveRow.hop)
)


def hops_of_search(session: Session, campaign_id: int, name: str, limit: int, after: int) -> HopsView:
    """Return the solves of the chains that have got some after an id, or of chains drawn from all."""
    campaign, row = get_search_row(session, campaign_id, name)
    spec = search_spec(campaign, row)
    # Of all searches: that of one would have to be looked for among all of its solves.
    last = session.scalar(select(func.max(SolveRow.id))) or 0
    jobs = _newer(row, after) if after else _sampled_jobs(session, row, spec, limit)
    query = _SOLVES.where(SolveRow.job_id.in_(jobs), SolveRow.id <= last).limit(limit)
    solves = [dict(found) for found in session.execute(query).mappings()]
    seeds = _seeds(session, solves)
    return HopsView(
        solves=_columns(solves, spec, [seed.id for seed in seeds]),
        seeds=seeds,
        n_shown=len(solves),
        n_all=row.n_solves,
        last=last,
    )


def _newer(row: SearchRow, after: int) -> Select[int]:
    # The sum keeps the index of the search out of it: few solves are new, and many are the search's.
    return select(SolveRow.job_id).where(SolveRow.id > after, SolveRow.search_id + 0 == row.id)


def _sampled_jobs(session: Session, row: SearchRow, spec: SearchSpec, limit: int) -> Select[int]:
    """Return the query of the jobs to show: all, or of so many chains or seeds as fit."""
    jobs = select(JobRow.id).where(JobRow.search_id == row.id, JobRow.state != literal_column("'queued'"))
    if row.n_solves <= limit:
        return jobs
    if spec.seeds is not None:
        # Hashes of seeds are spread evenly as they are; all that was made of a seed is shown together.
        mark = 16**32 * limit // row.n_solves
        return jobs.where(JobRow.chain < f"{mark:032x}")
    n_chains = session.scalar(select(func.count()).select_from(jobs.subquery())) or 0
    n_wanted = max(1, n_chains * limit // row.n_solves)
    return select(jobs.order_by(mixed(JobRow.id), JobRow.id).limit(n_wanted).subquery().c.id)


def _columns(solves: list[dict[str, Any]], spec: SearchSpec, seeds: list[str]) -> HopColumns:
    columns: dict[str, list[Any]] = {name: [] for name in HopColumns.model_fields}
    places = {seed: place for place, seed in enumerate(seeds)}
    for (_, chain), group in groupby(solves, lambda solve: (solve["case"], solve["chain"])):
        of_chain = list(group)
        number = int(chain, 16) if spec.seeds is None else places[of_chain[0]["seed_id"]]
        for solve, width in zip(of_chain, _widths(of_chain, spec), strict=True):
            shown = solve | {"chain": number, "width": width}
            for name, values in columns.items():
                values.append(shown[name])
    return HopColumns(**columns)


def _widths(of_chain: list[dict[str, Any]], spec: SearchSpec) -> list[float | None]:
    """Return the widths of a chain's hops, as far as the chain is known from its first on."""
    nothing: list[float | None] = [None] * len(of_chain)
    first = of_chain[0]["first_hop"]
    # A chain that was cut short and goes on may hand in its later hops first.
    is_whole = [solve["hop"] for solve in of_chain] == list(range(first, first + len(of_chain)))
    if spec.seeds is not None or not is_whole:
        return nothing
    return widths(spec.laws, ((s["move"], s["violation"]) for s in of_chain))


def _seeds(session: Session, solves: list[dict[str, Any]]) -> list[SeedOfSearch]:
    ids = {solve["seed_id"] for solve in solves if solve["seed_id"]}
    found: list[SeedOfSearch] = []
    again = aliased(SolveRow)
    first = (
        select(func.min(again.id))
        .where(again.solution_id == SolutionRow.id)
        .correlate(SolutionRow)
        .scalar_subquery()
    )
    query = (
        select(
            SolutionRow.id,
            SearchRow.name.label("search"),
            SearchRow.strategy,
            SolutionRow.delta_v_km_s,
            SolutionRow.time_of_flight_days,
        )
        .select_from(SolutionRow)
        .join(SolveRow, SolveRow.id == first)
        .join(SearchRow, SearchRow.id == SolveRow.search_id)
    )
    ordered = sorted(ids)
    # As many at a time as both databases take in one list.
    for begin in range(0, len(ordered), 500):
        part = query.where(SolutionRow.id.in_(ordered[begin : begin + 500])).order_by(SolutionRow.id)
        found.extend(SeedOfSearch(**row) for row in session.execute(part).mappings())
    return found
