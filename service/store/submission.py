"""From a specification to the rows of a campaign, and planning what each search needs next."""

from collections.abc import Sequence

from sqlalchemy import func, select, update
from sqlalchemy.orm import Session

from core.analysis.distinct import features
from core.problem import Problem
from service.db.counts import counted
from service.db.dialect import insert_new
from service.db.tables import CampaignRow, CaseRow, JobRow, ProblemRow, SearchRow, SolutionRow, SolveRow
from service.scheduler import plan
from service.scheduler.plan import Candidate, PlannedJob, Progress
from service.search_spec import SearchSpec
from service.spec import Spec, SpecError
from service.store.events import note
from service.store.find import find_campaign
from service.store.specs import search_spec, spec_of

ENDED = ("done", "cancelled")


def submit(session: Session, spec: Spec, now: float) -> tuple[int, bool]:
    """Return the campaign of a specification and whether it is new: the same one is the same campaign."""
    known = session.scalar(select(CampaignRow.id).where(CampaignRow.spec_hash == spec.hash))
    if known is not None:
        return known, False
    campaign = CampaignRow(
        name=spec.campaign.name,
        spec_hash=spec.hash,
        spec=spec.as_fields(),
        rng_seed=spec.campaign.rng_seed,
        state="active",
        created_at=now,
    )
    session.add(campaign)
    session.flush()
    _add_searches(session, campaign, spec)
    _take_known_seeds(session, campaign, now)
    note(session, campaign.id, "campaign", now, state="active")
    advance(session, campaign, now)
    return campaign.id, True


def _add_searches(session: Session, campaign: CampaignRow, spec: Spec) -> None:
    ids: dict[str, int] = {}
    for position, search in spec.in_order:
        row = SearchRow(
            campaign_id=campaign.id,
            position=position,
            name=search.id,
            strategy=search.strategy,
            source_id=_source_id(session, spec, search, ids),
            state="waiting",
        )
        session.add(row)
        session.flush()
        ids[search.id] = row.id
        _add_cases(session, row, spec.problems_of(search))


def _take_known_seeds(session: Session, campaign: CampaignRow, now: float) -> None:
    """Plan the jobs of seeds that another campaign has found already, where each is mapped at once.

    A search whose seeds can no longer be found is refused.
    """
    spec = spec_of(campaign)
    for row in session.scalars(select(SearchRow).where(SearchRow.campaign_id == campaign.id)):
        search = search_spec(campaign, row)
        if search.seeds is None or search.seeds.campaign is None:
            continue
        known = candidates(session, campaign, row)
        if not known and session.get_one(SearchRow, row.source_id).state in ENDED:
            about = f"search {search.id}: seeds.from: expected {search.seeds.tolerance} solutions"
            raise SpecError(f"{about}, got none from {search.seeds.full_name}, which has ended")
        for seed in known if search.is_immediate else ():
            for job in plan.map_jobs(spec, search, seed):
                add_job(session, search, row, job, now)


def _source_id(session: Session, spec: Spec, search: SearchSpec, ids: dict[str, int]) -> int | None:
    if search.seeds is None:
        return None
    if search.seeds.campaign is None:
        return ids[search.seeds.source]
    other = session.get_one(CampaignRow, find_campaign(session, search.seeds.campaign))
    found = select(SearchRow).where(SearchRow.campaign_id == other.id, SearchRow.name == search.seeds.source)
    row = session.scalar(found)
    about = f"search {search.id}: seeds.from"
    if row is None:
        raise SpecError(f"{about}: expected a search of campaign {other.name}, got {search.seeds.source!r}")
    if spec_of(other).problem.hash != spec.problem.hash:
        raise SpecError(
            f"{about}: expected the same reference problem, got another one in campaign {other.name}"
        )
    try:
        spec.require_source(search, search_spec(other, row))
    except ValueError as error:
        raise SpecError(str(error)) from error
    return row.id


def _add_cases(session: Session, row: SearchRow, problems: Sequence[Problem]) -> None:
    for position, problem in enumerate(problems):
        fields = {
            "hash": problem.hash,
            "definition": problem.model_dump(mode="json"),
            "k": problem.k,
            "n_segments": problem.n_segments,
        }
        insert_new(session, ProblemRow, fields)
        session.add(CaseRow(search_id=row.id, position=position, problem_hash=problem.hash))
    session.flush()


def advance(session: Session, campaign: CampaignRow, now: float) -> None:
    """Plan what the searches of a campaign need now, and end those that need nothing more.

    So do the campaigns that live on its seeds, and those that live on theirs; each is younger than its
    source, so this ends.
    """
    _advance_one(session, campaign, now)
    own = select(SearchRow.id).where(SearchRow.campaign_id == campaign.id)
    fed = select(SearchRow.campaign_id).where(SearchRow.source_id.in_(own))
    others = (CampaignRow.id.in_(fed)) & (CampaignRow.id != campaign.id) & (CampaignRow.state == "active")
    for other in session.scalars(select(CampaignRow).where(others)).all():
        advance(session, other, now)


def _advance_one(session: Session, campaign: CampaignRow, now: float) -> None:
    session.flush()
    rows = session.scalars(select(SearchRow).where(SearchRow.campaign_id == campaign.id)).all()
    sources = select(SearchRow.id, SearchRow.state).where(SearchRow.id.in_([row.source_id for row in rows]))
    states = {row_id: state for row_id, state in session.execute(sources)}
    states |= {row.id: row.state for row in rows}
    for row in sorted(rows, key=lambda row: row.id):  # sources were stored first
        if row.state not in ENDED:
            _advance_search(session, campaign, row, states.get(row.source_id or 0, "done") in ENDED, now)
            states[row.id] = row.state
    if campaign.state == "active" and all(states[row.id] in ENDED for row in rows):
        campaign.state, campaign.finished_at = "done", now
        note(session, campaign.id, "campaign", now, state="done")


def _advance_search(
    session: Session, campaign: CampaignRow, row: SearchRow, source_has_ended: bool, now: float
) -> None:
    search = search_spec(campaign, row)
    progress = progress_of(session, search, row, source_has_ended)
    if plan.is_exhausted(search, progress) and progress.n_queued:
        queued = (JobRow.search_id == row.id) & (JobRow.state == "queued")
        session.execute(update(JobRow).where(queued).values(state="cancelled", updated_at=now))
        progress = progress_of(session, search, row, source_has_ended)
    new = [*plan.next_chains(search, progress), *_chosen_seeds(session, campaign, row, progress)]
    added = [job for job in new if add_job(session, search, row, job, now)]
    state = plan.search_state(search, progress, added)
    if state != row.state:
        row.state = state
        note(session, campaign.id, "search", now, search=row.name, search_id=row.id, state=state)


def _chosen_seeds(
    session: Session, campaign: CampaignRow, row: SearchRow, progress: Progress
) -> list[PlannedJob]:
    """Return the map jobs of a search that chooses among the seeds when they are complete."""
    search = search_spec(campaign, row)
    if search.seeds is None or search.is_immediate or not progress.source_has_ended:
        return []
    if row.state != "waiting":
        # They were chosen once, when the source ended; each outcome would choose among all of them again.
        return []
    if plan.is_exhausted(search, progress):
        return []
    return plan.jobs_of_seeds(spec_of(campaign), search, candidates(session, campaign, row))


def candidates(session: Session, campaign: CampaignRow, row: SearchRow) -> list[Candidate]:
    """Return the different solutions of the source of a search, each at its first address."""
    seeds = search_spec(campaign, row).seeds
    assert seeds is not None
    is_good = SolveRow.strict if seeds.tolerance == "strict" else SolveRow.paper
    query = (
        select(SolutionRow, JobRow.case_index, JobRow.chain, SolveRow.hop)
        .join(SolveRow, SolveRow.solution_id == SolutionRow.id)
        .join(JobRow, JobRow.id == SolveRow.job_id)
        .where(SolveRow.search_id == row.source_id, is_good)
        .order_by(JobRow.case_index.desc(), JobRow.chain.desc(), SolveRow.hop.desc())
    )
    problem = spec_of(campaign).problem if seeds.order == "diversity" else None
    source = session.get_one(SearchRow, row.source_id)
    cases = search_spec(session.get_one(CampaignRow, source.campaign_id), source).outage_sets
    found = {
        solution.id: Candidate(
            solution.id,
            (case, chain, hop),
            cases[case],
            solution.delta_v_km_s,
            solution.time_of_flight_days,
            features(problem, solution.x) if problem else None,
        )
        for solution, case, chain, hop in session.execute(query)
    }
    return list(found.values())


def add_job(session: Session, search: SearchSpec, row: SearchRow, job: PlannedJob, now: float) -> bool:
    """Put a job into the queue unless its address is taken; return whether it is new."""
    values = {
        "search_id": row.id,
        "kind": job.kind,
        "case_index": job.case,
        "chain": f"{job.chain:032x}",
        "hop": job.hop,
        "n_hops": job.n_hops,
        "seed_id": job.seed_id,
        "mapping": job.mapping,
        "state": "queued",
        "priority": plan.priority(search),
        "attempt": 0,
        "n_failures": 0,
        "created_at": now,
        "updated_at": now,
    }
    return insert_new(session, JobRow, values)


def progress_of(session: Session, search: SearchSpec, row: SearchRow, source_has_ended: bool) -> Progress:
    """Return how far a search is; sums over its solves are made only where a budget asks for them."""
    by_state = select(JobRow.state, func.count()).where(JobRow.search_id == row.id).group_by(JobRow.state)
    counts = counted(session, by_state)
    solves = SolveRow.search_id == row.id
    cpu_seconds = n_solutions = 0
    if search.core_seconds is not None:
        cpu_seconds = session.scalar(select(func.sum(SolveRow.cpu_seconds)).where(solves)) or 0
    if search.solutions is not None:
        strict = select(func.count(SolveRow.solution_id.distinct())).where(solves, SolveRow.strict)
        n_solutions = session.scalar(strict) or 0
    return Progress(
        n_chains=sum(counts.values()),
        n_queued=counts.get("queued", 0),
        n_running=counts.get("running", 0),
        cpu_seconds=float(cpu_seconds),
        n_solutions=n_solutions,
        source_has_ended=source_has_ended,
    )
