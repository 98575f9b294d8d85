"""From a specification to the rows of a campaign, and planning what each search needs next."""

from sqlalchemy import func, select, update
from sqlalchemy.orm import Session

from service.db.counts import counted
from service.db.dialect import insert_new
from service.db.tables import CampaignRow, JobRow, ProblemRow, SearchRow, SolutionRow, SolveRow
from service.scheduler import plan
from service.scheduler.plan import Candidate, PlannedJob, Progress
from service.spec import SearchSpec, Spec
from service.store.events import note
from service.store.specs import search_spec

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
    note(session, campaign.id, "campaign", now, state="active")
    advance(session, campaign, now)
    return campaign.id, True


def _add_searches(session: Session, campaign: CampaignRow, spec: Spec) -> None:
    ids: dict[str, int] = {}
    # A source has fewer outages than what it feeds, so this order meets every source first.
    for position, search in sorted(enumerate(spec.search), key=lambda entry: (entry[1].k, entry[0])):
        problem = spec.problem_of(search)
        definition = problem.model_dump(mode="json")
        fields = {
            "hash": problem.hash,
            "definition": definition,
            "k": problem.k,
            "n_segments": problem.n_segments,
        }
        insert_new(session, ProblemRow, fields)
        row = SearchRow(
            campaign_id=campaign.id,
            position=position,
            name=search.id,
            strategy=search.strategy,
            problem_hash=problem.hash,
            source_id=ids[search.seeds.source] if search.seeds else None,
            state="waiting",
        )
        session.add(row)
        session.flush()
        ids[search.id] = row.id


def advance(session: Session, campaign: CampaignRow, now: float) -> None:
    """Plan what the searches of a campaign need now, and end those that need nothing more."""
    session.flush()
    rows = session.scalars(select(SearchRow).where(SearchRow.campaign_id == campaign.id)).all()
    states = {row.id: row.state for row in rows}
    for row in sorted(rows, key=lambda row: search_spec(campaign, row).k):
        if row.state not in ENDED:
            _advance_search(session, campaign, row, states.get(row.source_id or 0, "done") in ENDED, now)
            states[row.id] = row.state
    if campaign.state == "active" and all(state in ENDED for state in states.values()):
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
    new = [*plan.next_chains(search, progress), *_ordered_seeds(session, search, row, progress)]
    added = [job for job in new if add_job(session, search, row, job, now)]
    state = plan.search_state(search, progress, added)
    if state != row.state:
        row.state = state
        note(session, campaign.id, "search", now, search=row.name, search_id=row.id, state=state)


def _ordered_seeds(
    session: Session, search: SearchSpec, row: SearchRow, progress: Progress
) -> list[PlannedJob]:
    """Return the map jobs of a search that chooses among the seeds when they are complete."""
    if search.seeds is None or search.seeds.is_immediate or not progress.source_has_ended:
        return []
    if row.state != "waiting":
        # They were chosen once, when the source ended; each outcome would choose among all of them again.
        return []
    if plan.is_exhausted(search, progress):
        return []
    assert row.source_id is not None
    return [plan.map_job(seed.id) for seed in plan.chosen(search.seeds, candidates(session, row.source_id))]


def candidates(session: Session, search_id: int) -> list[Candidate]:
    """Return the different strict solutions of a search, each at its first address."""
    query = (
        select(SolutionRow, JobRow.case_index, JobRow.chain, SolveRow.hop)
        .join(SolveRow, SolveRow.solution_id == SolutionRow.id)
        .join(JobRow, JobRow.id == SolveRow.job_id)
        .where(SolveRow.search_id == search_id, SolveRow.strict)
        .order_by(JobRow.case_index.desc(), JobRow.chain.desc(), SolveRow.hop.desc())
    )
    found = {
        row.id: Candidate(row.id, (case, chain, hop), row.delta_v_km_s, row.time_of_flight_days)
        for row, case, chain, hop in session.execute(query)
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
