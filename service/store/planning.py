"""From a specification to the rows of a campaign, and planning what each search needs next.

The solutions that may become seeds of a search.
"""

from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Any

from sqlalchemy import (
    ColumnElement,
    Select,
    bindparam,
    exists,
    func,
    insert,
    literal_column,
    null,
    or_,
    select,
    update,
)
from sqlalchemy.orm import Session, aliased

from core.analysis.similarity import features
from core.problem import Problem, definitions_of, hashes_of, problem_from
from core.search import refined_problem
from service import scheduler
from service.db.dialect import insert_and_tell, insert_new, insert_new_rows, plain
from service.db.tables import (
    CampaignRow,
    CaseRow,
    JobRow,
    ProblemRow,
    SearchRow,
    SolutionRow,
    SolveRow,
    SubmissionRow,
)
from service.db.transitions import ENDED
from service.scheduler import Candidate, PlannedJob, Progress
from service.spec import Spec, SpecError
from service.spec.search_spec import SearchSpec
from service.store.cache import definition_of, search_spec, spec_of
from service.store.claims import Worked
from service.store.errors import KeyReusedError
from service.store.events import add_event, add_search_event
from service.store.filters import find_campaign
from service.store.statistics import n_solutions, tallies

#: Rows that are fetched at once where not all may be needed.
STEP = 200


def candidates(
    session: Session, campaign: CampaignRow, row: SearchRow, search: SearchSpec, most: int | None = None
) -> list[Candidate]:
    """Return the different solutions of the source of a search, each at its first address.

    With `most` it stops at so many of those that come first, if their order is that of an index.
    """
    assert search.seeds is not None
    if search.seeds.solution is not None:
        return [_named_seed(session, campaign, search, search.seeds.solution)]
    source = session.get_one(SearchRow, row.source_id)
    source_spec = search_spec(session.get_one(CampaignRow, source.campaign_id), source)
    query = _query(source, source_spec, search, most is not None)
    is_ordered = search.seeds.order in (None, "delta_v")
    problem = spec_of(campaign).problem
    cases = source_spec.outage_sets
    found: dict[str, Candidate] = {}
    for key, case, chain, hop, delta_v, time_of_flight, x in session.execute(
        query.execution_options(yield_per=STEP)
    ):
        if key not in found:
            shape = None if x is None else features(problem, x)
            found[key] = Candidate(key, (case, chain, hop), cases[case], delta_v, time_of_flight, shape)
        if is_ordered and len(found) == most:
            break
    return list(found.values())


def n_candidates(session: Session, row: SearchRow, search: SearchSpec) -> int:
    """Return how many candidates there are."""
    assert search.seeds is not None
    if search.seeds.solution is not None:
        return 1
    counted = tallies(session, SearchRow.id == row.source_id).get(row.source_id or 0, {})
    noun = "strict" if search.seeds.tolerance == "strict" else "solution"
    return n_solutions(counted.get(noun, {}), "search")


def _named_seed(session: Session, campaign: CampaignRow, search: SearchSpec, solution_id: str) -> Candidate:
    """Return the one solution that a search names, or raise unless it can be a seed of it."""
    about = f"search {search.id}: seeds.solution"
    row = session.get(SolutionRow, solution_id)
    if row is None:
        raise SpecError(f"{about}: expected a solution of this archive, got {solution_id}")
    problem = problem_from(definition_of(session, row.problem_hash))
    if search.is_refinement:
        problem = _refine(problem, spec_of(campaign).problem.n_segments, about)
    if problem.family != spec_of(campaign).problem.hash:
        raise SpecError(f"{about}: expected one of the same reference problem, got that of another")
    if search.seeds and search.seeds.tolerance == "strict" and not row.strict:
        raise SpecError(f'{about}: expected a strict one, got one of the paper\'s level; tolerance = "paper"')
    if search.seed_k not in (0, problem.k):
        raise SpecError(f"{about}: expected one with {search.seed_k} outages, got {problem.k}")
    # S(k|0) takes its reference alone.
    outages = problem.outages if search.seed_k else ()
    case = tuple((outage.segment, outage.duration_days) for outage in outages)
    return Candidate(row.id, (0, row.id, 0), case, row.delta_v_km_s, row.time_of_flight_days)


def _refine(problem: Problem, n_segments: int, about: str) -> Problem:
    try:
        return refined_problem(problem, n_segments)
    except ValueError as error:
        raise SpecError(f"{about}: {error}") from error


def _query(source: SearchRow, source_spec: SearchSpec, search: SearchSpec, is_cut: bool) -> Select[Any]:
    """Return the query of (id, case, chain, hop, delta-v, time of flight, vector or None)."""
    assert search.seeds is not None
    is_good = SolveRow.strict if search.seeds.tolerance == "strict" else SolveRow.paper
    # Vectors are large, and only one order looks at them.
    x = SolutionRow.x if search.seeds.order == "diversity" else null()
    # Of solves or of jobs, whichever has an index in the order that is wanted.
    mine: ColumnElement[bool] = JobRow.search_id == source.id
    mine &= JobRow.kind == ("hop" if source_spec.seed_k is None else "map")
    order: list[Any] = [JobRow.case_index, JobRow.chain, JobRow.hop, SolveRow.hop]
    if is_cut and search.seeds.order == "delta_v":
        # The most final mass is the least delta-v.
        mine = (SolveRow.search_id == source.id) & SolveRow.solution_id.is_not(None)
        order = [SolveRow.final_mass_kg.desc(), *order]
    return (
        select(SolutionRow.id, JobRow.case_index, JobRow.chain, SolveRow.hop)
        .add_columns(SolutionRow.delta_v_km_s, SolutionRow.time_of_flight_days, x)
        .join(SolveRow, SolveRow.solution_id == SolutionRow.id)
        .join(JobRow, JobRow.id == SolveRow.job_id)
        .where(mine, is_good)
        .order_by(*order)
    )


#: A campaign of more cases or searches is stored in pieces, between which others write.
MOST_CASES_AT_ONCE, MOST_SEARCHES_AT_ONCE = 500, 8

_JOB = plain(JobRow).c
#: Whether more than `before` jobs of a search are in the queue.
_NTH_QUEUED = (
    select(_JOB.id)
    .where(_JOB.search_id == bindparam("search_id"), _JOB.state == literal_column("'queued'"))
    .limit(1)
    .offset(bindparam("before"))
)
#: How many jobs of a search are in a state, up to `most`.
_AT_MOST = select(func.count()).select_from(
    select(_JOB.id)
    .where(_JOB.search_id == bindparam("search_id"), _JOB.state == bindparam("state"))
    .limit(bindparam("most"))
    .subquery()
)
_CASE = insert(plain(CaseRow))
#: What tells the jobs of one search apart.
_ADDRESS = ("kind", "case_index", "chain", "hop")
_SOURCE = aliased(SearchRow)
#: Searches whose first jobs are still to be planned.  One that waits for seeds has a source that goes on, and
#: no job in the queue.
_UNPLANNED = (
    select(SearchRow, CampaignRow)
    .join(CampaignRow, CampaignRow.id == SearchRow.campaign_id)
    .outerjoin(_SOURCE, _SOURCE.id == SearchRow.source_id)
    .where(SearchRow.state == "waiting", CampaignRow.state.not_in(ENDED))
    .where(
        or_(
            SearchRow.source_id.is_(None),
            _SOURCE.state.in_(ENDED),
            exists().where(_JOB.search_id == SearchRow.id, _JOB.state == literal_column("'queued'")),
        )
    )
    .order_by(SearchRow.id)
)


class Cases:
    """What is stored of a specification and all its problems, made before a transaction begins."""

    def __init__(self, spec: Spec) -> None:
        self.spec_hash = spec.hash
        self.spec_fields = spec.as_fields()
        #: By search, in the order of the specification.
        self.hashes: list[list[str]] = []
        self.problems: dict[str, dict[str, Any]] = {}
        for search in spec.search:
            problems = spec.problems_of(search)
            hashes = hashes_of(problems)
            self.hashes.append(hashes)
            self.problems |= dict(zip(hashes, _problem_rows(problems, hashes), strict=True))
        self.is_small = (
            len(spec.search) <= MOST_SEARCHES_AT_ONCE and sum(map(len, self.hashes)) <= MOST_CASES_AT_ONCE
        )

    def pieces(self) -> Iterator[list[dict[str, Any]]]:
        """Yield the rows of the problems, so many at a time."""
        rows = iter(self.problems.values())
        while piece := list(islice(rows, MOST_CASES_AT_ONCE)):
            yield piece


def is_known(session: Session, spec: Spec, key: str | None) -> bool:
    """Return whether a key or a specification was submitted before."""
    if key is not None and session.get(SubmissionRow, key) is not None:
        return True
    return session.scalar(select(CampaignRow.id).where(CampaignRow.spec_hash == spec.hash)) is not None


def add_problems(session: Session, rows: Sequence[dict[str, Any]]) -> None:
    """Store problems that are not there yet; a campaign of them may follow."""
    insert_new_rows(session, ProblemRow, rows)


def submit(
    session: Session, spec: Spec, now: float, key: str | None = None, cases: Cases | None = None
) -> tuple[int, bool]:
    """Return the campaign of a specification and whether it is new: the same one is the same campaign.

    A key belongs to the first specification that came with it.  Of a large campaign, jobs are left to
    `plan_piece`, and its searches wait until then.
    """
    spec_hash = spec.hash if cases is None else cases.spec_hash
    if key is not None and (earlier := session.get(SubmissionRow, key)):
        if earlier.spec_hash != spec_hash:
            raise KeyReusedError(
                f"idempotency key {key}: expected the specification of campaign {earlier.campaign_id}, with "
                f"which it came first, got another one; use a new key"
            )
        return earlier.campaign_id, False
    known = session.scalar(select(CampaignRow.id).where(CampaignRow.spec_hash == spec_hash))
    campaign_id = known or _begin(session, spec, now, cases or Cases(spec))
    if key is not None:
        session.add(SubmissionRow(key=key, spec_hash=spec_hash, campaign_id=campaign_id, created_at=now))
    return campaign_id, known is None


def plan_piece(session: Session, campaign_id: int, now: float) -> None:
    """Plan the first jobs of some searches of a campaign that have none yet.

    Planned twice is planned once, so whoever finds a campaign that was left between two pieces goes on.
    """
    wanted = _UNPLANNED.where(CampaignRow.id == campaign_id).limit(MOST_SEARCHES_AT_ONCE)
    found = session.execute(wanted).all()
    for row, campaign in found:
        _advance_search(session, campaign, row, _has_source_ended(session, row), now)
    session.flush()
    if len(found) < MOST_SEARCHES_AT_ONCE:
        # The last ones: a campaign without a job to do is done.
        _end_if_idle(session, campaign_id, now)


def unplanned(session: Session, campaign_id: int | None = None) -> list[int]:
    """Return the campaigns, or whether one is among them, of which searches are still to be planned."""
    ids = _UNPLANNED.with_only_columns(CampaignRow.id).order_by(None).distinct()
    return list(session.scalars(ids if campaign_id is None else ids.where(CampaignRow.id == campaign_id)))


def _has_source_ended(session: Session, row: SearchRow) -> bool:
    return row.source_id is None or session.get_one(SearchRow, row.source_id).state in ENDED


def _end_if_idle(session: Session, campaign_id: int, now: float) -> None:
    open_one = select(SearchRow.id).where(SearchRow.campaign_id == campaign_id, SearchRow.state.not_in(ENDED))
    if session.scalar(open_one.limit(1)) is None:
        advance(session, session.get_one(CampaignRow, campaign_id), now)


def _begin(session: Session, spec: Spec, now: float, cases: Cases) -> int:
    campaign = CampaignRow(
        name=spec.campaign.name,
        spec_hash=cases.spec_hash,
        spec=cases.spec_fields,
        rng_seed=spec.campaign.rng_seed,
        state="active",
        priority=spec.campaign.priority,
        created_at=now,
    )
    session.add(campaign)
    session.flush()
    add_problems(session, list(cases.problems.values()) if cases.is_small else [])
    _add_searches(session, campaign, spec, cases)
    _take_known_seeds(session, campaign, spec, now)
    add_event(session, campaign.id, "campaign", now, state="active")
    if cases.is_small:
        advance(session, campaign, now)
    return campaign.id


def _add_searches(session: Session, campaign: CampaignRow, spec: Spec, cases: Cases) -> None:
    ids: dict[str, int] = {}
    for position, search in spec.in_order:
        row = SearchRow(
            campaign_id=campaign.id,
            position=position,
            name=search.id,
            strategy=search.strategy,
            source_id=_source_id(session, spec, search, ids),
            state="waiting",
            priority=scheduler.priority(search),
            weight=search.weight,
        )
        session.add(row)
        session.flush()
        ids[search.id] = row.id
        _refer_to(session, row, cases.hashes[position])


def _take_known_seeds(session: Session, campaign: CampaignRow, spec: Spec, now: float) -> None:
    """Plan the jobs of seeds that another campaign has found already, where each is mapped at once.

    A search whose seeds can no longer be found is refused.
    """
    for row in session.scalars(select(SearchRow).where(SearchRow.campaign_id == campaign.id)):
        search = spec.search[row.position]
        if search.seeds is None or (search.seeds.campaign is None and search.seeds.solution is None):
            continue
        known = candidates(session, campaign, row, search)
        source = row.source_id and session.get_one(SearchRow, row.source_id)
        if not known and source and source.state in ENDED:
            about = f"search {search.id}: seeds.from: expected {search.seeds.tolerance} solutions"
            raise SpecError(f"{about}, got none from {search.seeds.full_name}, which has ended")
        if search.is_immediate:
            jobs = [job for seed in known for job in scheduler.map_jobs(spec, search, seed)]
            if search.seeds.solution is not None and not jobs:
                about = f"search {search.id}: seeds.solution: expected one that fits its outages"
                raise SpecError(f"{about}, got {search.seeds.solution}")
            add_jobs(session, search, row, jobs, now)


def _source_id(session: Session, spec: Spec, search: SearchSpec, ids: dict[str, int]) -> int | None:
    if search.seeds is None or search.seeds.source is None:
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


def add_problem(session: Session, problem: Problem) -> bool:
    """Store a problem; return whether it is new."""
    return insert_new(session, ProblemRow, _problem_rows([problem], [problem.hash])[0])


def add_cases(session: Session, row: SearchRow, problems: Sequence[Problem]) -> None:
    """Store the cases of a search, and their problems where they are new."""
    hashes = hashes_of(problems)
    add_problems(session, _problem_rows(problems, hashes))
    _refer_to(session, row, hashes)


def _refer_to(session: Session, row: SearchRow, hashes: Sequence[str]) -> None:
    common = {"search_id": row.id}
    cases = [common | {"position": n, "problem_hash": one} for n, one in enumerate(hashes)]
    session.connection().execute(_CASE, cases)


def _problem_rows(problems: Sequence[Problem], hashes: Sequence[str]) -> list[dict[str, Any]]:
    return [
        {"hash": one, "definition": definition, "k": problem.k, "n_segments": problem.n_segments}
        for problem, one, definition in zip(problems, hashes, definitions_of(problems), strict=True)
    ]


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


def go_on_after(session: Session, work: Worked, now: float) -> None:
    """Do what `advance` would do after outcomes, asking only the searches that they can have changed.

    A campaign may have hundreds of searches; asking each of them cost more than all the rest of an outcome.
    """
    search = work.search
    if search.state in ENDED:
        advance(session, work.campaign, now)
        return
    if search.state != "active" or _needs_jobs(session, work):
        session.flush()
        source = search.source_id and session.get_one(SearchRow, search.source_id)
        _advance_search(session, work.campaign, search, not source or source.state in ENDED, now)
    for row, owner in work.fed.values():
        if row.state != "active":
            session.flush()
            _advance_search(session, owner, row, search.state in ENDED, now)
    if search.state in ENDED:
        # What it fed may end as well, and then the campaign.
        advance(session, work.campaign, now)


def _needs_jobs(session: Session, work: Worked) -> bool:
    """Return whether a search may want more chains now, or may be about to end."""
    search = search_spec(work.campaign, work.search)
    if search.core_seconds is not None or search.solutions is not None:
        return True
    # Chains are planned some at a time; of a search that feeds on seeds any open job keeps it open.
    least = scheduler.CHAINS_AHEAD // 2 if search.seed_k is None else 1
    ready = {"search_id": work.search.id, "before": least - 1}
    return session.connection().execute(_NTH_QUEUED, ready).first() is None


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
    if campaign.state not in ENDED and all(states[row.id] in ENDED for row in rows):
        campaign.state, campaign.finished_at = "done", now
        add_event(session, campaign.id, "campaign", now, state="done")


def _advance_search(
    session: Session, campaign: CampaignRow, row: SearchRow, source_has_ended: bool, now: float
) -> None:
    search = search_spec(campaign, row)
    progress = progress_of(session, search, row, source_has_ended)
    if scheduler.is_exhausted(search, progress) and progress.n_queued:
        queued = (JobRow.search_id == row.id) & (JobRow.state == "queued")
        session.execute(update(JobRow).where(queued).values(state="cancelled", updated_at=now))
        progress = progress_of(session, search, row, source_has_ended)
    new = [*scheduler.next_chains(search, progress), *_chosen_seeds(session, campaign, row, progress)]
    added = add_jobs(session, search, row, new, now)
    state = scheduler.search_state(search, progress, added)
    if row.state == "paused" and state != "done":
        return
    if state != row.state:
        enter(session, campaign, row, state, now)


def enter(session: Session, campaign: CampaignRow, row: SearchRow, state: str, now: float) -> None:
    """Give a search another state; one that joins others at work begins with as much as they have had."""
    if state == "active":
        equal = (CampaignRow.priority == campaign.priority) & (SearchRow.priority == row.priority)
        at_work = equal & (SearchRow.state == "active") & (CampaignRow.state == "active")
        least = select(func.min(SearchRow.served_s)).join(CampaignRow).where(at_work)
        row.served_s = max(row.served_s, session.scalar(least) or 0.0)
    row.state = state
    add_search_event(session, row, now)


def _chosen_seeds(
    session: Session, campaign: CampaignRow, row: SearchRow, progress: Progress
) -> list[PlannedJob]:
    """Return the map jobs of a search that chooses among the seeds when they are complete."""
    search = search_spec(campaign, row)
    if search.seeds is None or search.is_immediate or not progress.source_has_ended:
        return []
    is_first = row.state == "waiting" or (row.state == "paused" and not row.n_planned)
    if not is_first:
        # They were chosen once, when the source ended; each outcome would choose among all of them again.
        return []
    if scheduler.is_exhausted(search, progress):
        return []
    return scheduler.jobs_of_seeds(spec_of(campaign), search, candidates(session, campaign, row, search))


def add_jobs(
    session: Session, search: SearchSpec, row: SearchRow, jobs: Sequence[PlannedJob], now: float
) -> list[PlannedJob]:
    """Put jobs into the queue unless their addresses are taken; return those that are new."""
    rows = [_job_values(search, row, job, now) for job in jobs]
    new = insert_and_tell(session, JobRow, rows, *_ADDRESS)
    added = [job for job, values in zip(jobs, rows, strict=True) if tuple(values[n] for n in _ADDRESS) in new]
    row.n_planned += len(added)
    return added


def _job_values(search: SearchSpec, row: SearchRow, job: PlannedJob, now: float) -> dict[str, Any]:
    return {
        "search_id": row.id,
        "kind": job.kind,
        "case_index": job.case,
        "chain": f"{job.chain:032x}",
        "hop": job.hop,
        "n_hops": job.n_hops,
        "seed_id": job.seed_id,
        "mapping": job.mapping,
        "state": "queued",
        "priority": scheduler.priority(search),
        "attempt": 0,
        "n_failures": 0,
        "created_at": now,
        "updated_at": now,
    }


def progress_of(session: Session, search: SearchSpec, row: SearchRow, source_has_ended: bool) -> Progress:
    """Return how far a search is; what grows with it is counted as it comes, or only where a budget asks."""
    n_solutions = 0
    if search.solutions is not None:
        strict = (SolveRow.search_id == row.id) & SolveRow.strict
        n_solutions = session.scalar(select(func.count(SolveRow.solution_id.distinct())).where(strict)) or 0
    return Progress(
        n_chains=row.n_planned,
        n_queued=_at_most(session, row, "queued", scheduler.CHAINS_AHEAD),
        n_running=_at_most(session, row, "running", 1),
        cpu_seconds=row.cpu_seconds,
        n_solutions=n_solutions,
        source_has_ended=source_has_ended,
    )


def is_used_up(session: Session, search: SearchSpec, row: SearchRow) -> bool:
    """Return whether a search has a budget in core seconds or solutions that is used up."""
    if search.core_seconds is None and search.solutions is None:
        return False
    return scheduler.is_exhausted(search, progress_of(session, search, row, False))


def _at_most(session: Session, row: SearchRow, state: str, limit: int) -> int:
    """Return how many jobs are in a state, counted no further than needed."""
    return session.scalar(_AT_MOST, {"search_id": row.id, "state": state, "most": limit}) or 0
