"""Records results under fencing tokens: what follows from one is stored with it or not at all.

That are solves, solutions and the links to their seeds, and the jobs that a new solution seeds.
"""

import logging
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from sqlalchemy import bindparam, func, select, update
from sqlalchemy.orm import Session
from sqlalchemy.orm.attributes import set_committed_value

from core.plain_data import content_hash
from core.search import HopAddress
from service import scheduler
from service.db.dialect import insert_new, plain
from service.db.tables import (
    AttemptRow,
    CampaignRow,
    JobRow,
    ProvenanceRow,
    SearchRow,
    SeedLinkRow,
    SolutionRow,
    SolveRow,
    shared_columns,
)
from service.db.transitions import ENDED
from service.logs import say
from service.scheduler import backoff_s
from service.store.cache import facts_of_problem, search_spec, spec_of
from service.store.claims import (
    LockedAttempt,
    Turn,
    Worked,
    lock_attempt,
    message_of,
    require_claimant,
    seeds_of,
)
from service.store.errors import StoreError, UnknownRowError
from service.store.events import add_events, event_of, job_event
from service.store.planning import add_jobs, go_on_after, is_used_up
from service.store.statistics import Counts, scope_of
from service.validation import JobFacts, UnsoundError, require_outcome, require_records, solution_hash
from workers.messages import (
    KIND_NUMBERS,
    RESULTS,
    ChainPart,
    ChainPlace,
    CompleteAnswer,
    CompleteRequest,
    Ending,
    HandInAnswer,
    HandInRequest,
    JobOutcome,
    SolveRecord,
    StaleAttemptError,
    Ticket,
    job_digest,
)

log = logging.getLogger(__name__)

#: The searches that take the seeds of one, with their campaigns.
_FED = (
    select(SearchRow, CampaignRow)
    .join(CampaignRow, CampaignRow.id == SearchRow.campaign_id)
    .where(SearchRow.source_id == bindparam("source_id"))
    .order_by(SearchRow.id)
)
#: Fields of a record that a row takes over as they are.
COPIED = shared_columns(SolveRow, SolveRecord, but=("ending", "defects"))


def add_solve(
    session: Session, held: LockedAttempt, work: Worked, record: SolveRecord, counts: Counts, now: float
) -> None:
    """Store a solve and what it found, unless an earlier attempt had handed in the same hop."""
    job = held.job
    solution_id, scope = _add_solution(session, held, record, now)
    if not insert_new(session, SolveRow, _solve_values(job, record, solution_id, now)):
        return
    work.n_solves += 1
    work.cpu_seconds += record.cpu_seconds
    _count(counts, job.search_id, record, scope)
    if solution_id is None:
        return
    work.events.append(_solution_event(held, record, solution_id, now))
    if job.seed_id is not None and job.seed_id != solution_id:
        link = {"solution_id": solution_id, "seed_id": job.seed_id, "mapping": job.mapping}
        insert_new(session, SeedLinkRow, link)
    _plan_seeded(session, held, work, record, solution_id, now)


def _count(counts: Counts, search_id: int, record: SolveRecord, scope: str | None) -> None:
    counts.add(search_id, "solve", record.ending.value, record.cpu_seconds)
    counts.add(search_id, "status", record.status)
    for level in ("paper", "strict"):
        if record.certificate is not None and getattr(record.certificate, level):
            counts.add(search_id, "level", level)
    if scope is not None:
        counts.add(search_id, "solution", scope)
        if record.certificate is not None and record.certificate.strict:
            counts.add(search_id, "strict", scope)


def _solve_values(job: JobRow, record: SolveRecord, solution_id: str | None, now: float) -> dict[str, Any]:
    certificate = record.certificate
    return {name: getattr(record, name) for name in COPIED} | {
        "job_id": job.id,
        "search_id": job.search_id,
        "attempt": job.attempt,
        "ending": record.ending.value,
        "paper": certificate is not None and certificate.paper,
        "strict": certificate is not None and certificate.strict,
        "defects": _flat(record.defects),
        "solution_id": solution_id,
        "final_mass_kg": record.trajectory.final_mass_kg if solution_id and record.trajectory else None,
        "created_at": now,
    }


def _add_solution(
    session: Session, held: LockedAttempt, record: SolveRecord, now: float
) -> tuple[str | None, str | None]:
    """Store what a solve found, if anything; return its id, and the scope in which it is new."""
    if record.x is None or record.trajectory is None or record.certificate is None:
        return None, None
    problem_hash = held.problem_hash
    x = np.array(record.x)
    key = solution_hash(problem_hash, x)
    facts = record.trajectory.model_dump(exclude={"final_mass_kg"})
    is_new = insert_new(
        session,
        SolutionRow,
        facts
        | {
            "id": key,
            "problem_hash": problem_hash,
            "x": x,
            "objective_kg": record.trajectory.final_mass_kg,
            "defects": _flat(record.certificate.defects),
            "paper": record.certificate.paper,
            "strict": record.certificate.strict,
            "verification": record.certificate.details,
            "created_at": now,
        },
    )
    return key, "archive" if is_new else scope_of(session, key, held.search.id, held.campaign.id)


def _flat(defects: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    # None, which stands for what was not finite, becomes NaN here.
    return np.array(defects, dtype=np.float64).ravel()


def _solution_event(held: LockedAttempt, record: SolveRecord, solution_id: str, now: float) -> dict[str, Any]:
    assert record.trajectory is not None and record.certificate is not None
    return event_of(
        held.campaign.id,
        "solution",
        now,
        id=solution_id,
        search=held.search.name,
        search_id=held.search.id,
        delta_v_km_s=record.trajectory.delta_v_km_s,
        propellant_kg=record.trajectory.propellant_kg,
        strict=record.certificate.strict,
    )


def _plan_seeded(
    session: Session, held: LockedAttempt, work: Worked, record: SolveRecord, solution_id: str, now: float
) -> None:
    """Plan the map jobs of every search that takes each seed at once."""
    assert record.trajectory is not None and record.certificate is not None
    job = held.job
    seed = scheduler.Candidate(
        solution_id,
        (job.case_index, job.chain, record.hop),
        search_spec(held.campaign, held.search).outage_sets[job.case_index],
        record.trajectory.delta_v_km_s,
        record.trajectory.time_of_flight_days,
    )
    for row, owner in _takers(session, work):
        search = search_spec(owner, row)
        if search.seeds is None or not search.is_immediate or row.state in ENDED:
            continue
        is_good = record.certificate.strict or search.seeds.tolerance == "paper"
        if is_good and not is_used_up(session, search, row):
            if add_jobs(session, search, row, scheduler.map_jobs(spec_of(owner), search, seed), now):
                work.fed[row.id] = row, owner


def _takers(session: Session, work: Worked) -> Sequence[tuple[SearchRow, CampaignRow]]:
    """Return the searches that take seeds of this one, with their campaigns: another may feed on it."""
    if work.takers is None:
        # What is pending says nothing about them, and is stored together at the end.
        with session.no_autoflush:
            found = session.execute(_FED, {"source_id": work.search.id})
            work.takers = [(row, owner) for row, owner in found]
    return work.takers


#: Endings that say nothing about the job itself: it may run again.
FAILURES = (Ending.CRASH, Ending.LOST)
#: Endings of attempts whose own result may still arrive: it was lost, or its report was rejected.
UNHEARD = (Ending.LOST, Ending.ERROR)


_SEARCH = plain(SearchRow).c
_CHARGE = (
    update(plain(SearchRow))
    .where(_SEARCH.id == bindparam("row"))
    .values(
        n_solves=_SEARCH.n_solves + bindparam("number"),
        cpu_seconds=_SEARCH.cpu_seconds + bindparam("seconds"),
        served_s=_SEARCH.served_s + bindparam("seconds") / _SEARCH.weight,
    )
    .returning(_SEARCH.n_solves, _SEARCH.cpu_seconds, _SEARCH.served_s)
)


def complete(
    session: Session, reports: Sequence[CompleteRequest], now: float, by: str | None = None
) -> list[CompleteAnswer]:
    """Store outcomes, their solutions, their links and what follows from them, or refuse all with a late one.

    A report that was accepted before gets the stored answer, and changes nothing.  `by` names the token
    that reports, which has to be the one that claimed.
    """
    held = lock_attempt(session, [report.ticket for report in reports], by)
    worked: dict[int, Worked] = {}
    counts = Counts()
    answers: list[CompleteAnswer] = []
    for report in reports:
        ticket, outcome = report.ticket, report.outcome
        # The same report twice finds nothing the second time.
        mine = held.pop(ticket, None) or _reclaim(session, ticket, outcome, counts, now, by)
        if mine is not None and report.job_digest is not None:
            _require_same_job(session, mine, report.job_digest)
        if mine is None:
            answers.append(_repeat_answer(session, ticket, by))
            continue
        work = worked.setdefault(mine.search.id, Worked(mine.search, mine.campaign))
        _take_back(session, mine, work, outcome, counts, now)
        answers.append(_answer(ticket, mine.job.state))
    _follow_up(session, list(worked.values()), counts, now)
    return answers


def hand_in(session: Session, request: HandInRequest, now: float, by: str | None = None) -> HandInAnswer:
    """Store hops of a chain that goes on, behind the same fence and with all that follows from them.

    The next attempt begins after them.  What came before changes nothing.
    """
    ticket, part = request.ticket, request.part
    held = lock_attempt(session, [ticket], by).get(ticket)
    if held is None:
        raise _stale(ticket)
    try:
        require_records(job_facts(session, held), part.solves)
    except UnsoundError as error:
        raise StoreError(f"job {ticket.job_id}: {error}") from error
    work, counts = Worked(held.search, held.campaign), Counts()
    _add_solves(session, held, work, part.solves, counts, now)
    held.attempt.provenance_hash = _provenance(session, work, part)
    _move(session, held, part.place)
    _follow_up(session, [work], counts, now)
    next_hop = max(part.place.next_hop, held.job.place["next_hop"])
    return HandInAnswer(**ticket._asdict(), next_hop=next_hop)


def _follow_up(session: Session, worked: Sequence[Worked], counts: Counts, now: float) -> None:
    """Store what follows from new solves: totals, tallies, events, and the jobs that they plan."""
    for work in worked:
        _charge(session, work)
    counts.store(session)
    add_events(session, [event for work in worked for event in work.events])
    for work in worked:
        go_on_after(session, work, now)


def _add_solves(
    session: Session,
    held: LockedAttempt,
    work: Worked,
    solves: Sequence[SolveRecord],
    counts: Counts,
    now: float,
) -> None:
    try:
        for record in solves:
            add_solve(session, held, work, record, counts, now)
    except ValueError as error:
        raise StoreError(f"job {held.job.id}: {error}") from error


def _move(session: Session, held: LockedAttempt, place: ChainPlace) -> None:
    """Let the next attempt at a chain begin where this one stands."""
    job, thing = held.job, f"job {held.job.id}: place"
    before = (SolveRow.job_id == job.id) & (SolveRow.hop < place.next_hop)
    n_known = session.scalar(select(func.count()).select_from(SolveRow).where(before)) or 0
    if job.seed_id is not None or not job.hop < place.next_hop < job.hop + job.n_hops:
        raise StoreError(f"{thing}: expected a hop within its chain, got {place.next_hop}")
    if n_known != place.next_hop - job.hop:
        expected = place.next_hop - job.hop
        raise StoreError(f"{thing}: expected all {expected} hops before {place.next_hop}, got {n_known}")
    n_variables = facts_of_problem(session, held.problem_hash).layout.n_variables
    if place.x is not None and len(place.x) != n_variables:
        raise StoreError(f"{thing}: expected {n_variables} numbers in x, got {len(place.x)}")
    if job.place is None or job.place["next_hop"] < place.next_hop:
        # Failures in a row are counted; a chain of days may lose a worker now and then.
        job.place, job.n_failures = place.model_dump(mode="json"), 0


def _take_back(
    session: Session, held: LockedAttempt, work: Worked, outcome: JobOutcome, counts: Counts, now: float
) -> None:
    job = held.job
    require_sound(session, held, outcome)
    _add_solves(session, held, work, outcome.solves, counts, now)
    if outcome.place is not None:
        _move(session, held, outcome.place)
    end_attempt(job, outcome.ending, now)
    _close_attempt(session, held.attempt, work, outcome, job.state, now)
    counts.add(job.search_id, "attempt", outcome.ending.value)
    if job.state == "done":
        counts.add(job.search_id, "job", "done")
    work.events.append(job_event(held.search, job, now))
    _log(session, held, outcome.ending)


def _reclaim(
    session: Session, ticket: Ticket, outcome: JobOutcome, counts: Counts, now: float, by: str | None
) -> LockedAttempt | None:
    """Return a requeued job to an attempt that brings a late result, unless it was claimed since.

    The attempt of the next claim is another one, so the fence is as tight as it was.
    """
    if outcome.ending not in RESULTS:
        return None
    mine = lock_attempt(session, [ticket], by, "queued").get(ticket)
    if mine is None or mine.attempt.ending not in UNHEARD:
        return None
    counts.add(mine.job.search_id, "attempt", mine.attempt.ending, number=-1)
    mine.job.state, mine.job.lease_until = "running", now
    # There is no way from the queue to the end but this.
    session.flush()
    return mine


def _require_same_job(session: Session, held: LockedAttempt, digest: str) -> None:
    """Refuse the outcome of a job of another archive, which had the same number."""
    turn = Turn(held.job, held.problem_hash, held.search, held.campaign)
    if job_digest(message_of(session, turn, seeds_of(session, [turn]))) != digest:
        raise StoreError(
            f"job {held.job.id}: expected the outcome of this job, got that of another archive's"
        )


def require_sound(session: Session, held: LockedAttempt, outcome: JobOutcome) -> None:
    """Refuse an outcome that no run of its job can have had."""
    known = select(SolveRow.hop, SolveRow.ending).where(SolveRow.job_id == held.job.id)
    # Only what ran before can have left some, or the same attempt where it does not bring all.
    may_be = held.job.attempt > 1 or len(outcome.solves) < held.job.n_hops
    with session.no_autoflush:
        done = {hop: ending for hop, ending in session.execute(known)} if may_be else {}
    try:
        require_outcome(job_facts(session, held), outcome, done)
    except UnsoundError as error:
        raise StoreError(f"job {held.job.id}: {error}") from error


def job_facts(session: Session, held: LockedAttempt) -> JobFacts:
    """Return what the solves of a job have to agree with."""
    job, spec = held.job, search_spec(held.campaign, held.search)
    chain = int(job.chain, 16)
    address = HopAddress(KIND_NUMBERS[job.kind], held.search.position, job.case_index, chain, job.hop)
    about = facts_of_problem(session, held.problem_hash)
    return JobFacts(about, held.campaign.rng_seed, address, job.n_hops, spec.settings)


def _log(session: Session, held: LockedAttempt, ending: Ending) -> None:
    job = held.job
    level = logging.DEBUG if ending in RESULTS else logging.WARNING
    message = f"attempt ended: {ending.value}, the job is {job.state}"
    ids = {"campaign": held.campaign.id, "job": job.id, "attempt": job.attempt, "worker": job.worker}
    say(session, log, level, message, **ids)


def _repeat_answer(session: Session, ticket: Ticket, by: str | None) -> CompleteAnswer:
    if session.get(JobRow, ticket.job_id) is None:
        raise UnknownRowError("job", ticket.job_id)
    attempt = session.get(AttemptRow, tuple(ticket))
    if attempt is None or attempt.next_state is None:
        raise _stale(ticket)
    require_claimant(attempt, by)
    return _answer(ticket, attempt.next_state)


def _stale(ticket: Ticket) -> StaleAttemptError:
    return StaleAttemptError(
        f"job {ticket.job_id}: expected attempt {ticket.attempt} to hold it, got a stale report"
    )


def _answer(ticket: Ticket, state: str) -> CompleteAnswer:
    return CompleteAnswer(**ticket._asdict(), state=cast(Any, state))


def _charge(session: Session, work: Worked) -> None:
    """Charge a search with the solves that are new in the archive."""
    if not work.n_solves:
        return
    charged = {"row": work.search.id, "number": work.n_solves, "seconds": work.cpu_seconds}
    for name, total in session.connection().execute(_CHARGE, charged).one()._mapping.items():
        set_committed_value(work.search, name, total)


def end_attempt(job: JobRow, ending: Ending, now: float) -> None:
    """Give a running job the state that follows from how its attempt ended."""
    if ending in FAILURES and not job.is_cancelling:
        job.n_failures += 1
        job.not_before = now + backoff_s(job.n_failures)
    job.state = _state_after(job, ending)
    job.ending, job.lease_until, job.is_cancelling, job.updated_at = ending.value, None, False, now
    if job.state == "done":
        # Nothing goes on there.
        job.place = None


def _state_after(job: JobRow, ending: Ending) -> str:
    if ending in RESULTS:
        # Kept even if it was to be cancelled: it has been paid for.
        return "done"
    if job.is_cancelling and ending is not Ending.ERROR:
        return "cancelled"
    return scheduler.after_failure(ending.value, job.n_failures)


def _close_attempt(
    session: Session, attempt: AttemptRow, work: Worked, outcome: JobOutcome, next_state: str, now: float
) -> None:
    attempt.ended_at, attempt.ending, attempt.next_state = now, outcome.ending.value, next_state
    # PostgreSQL has no place for a NUL, which the last words of a process may hold.
    attempt.error = outcome.error and outcome.error.replace("\0", "\ufffd")
    # What died without a word may have handed in hops before.
    attempt.provenance_hash = _provenance(session, work, outcome) or attempt.provenance_hash


def _provenance(session: Session, work: Worked, outcome: JobOutcome | ChainPart) -> str | None:
    if outcome.provenance is None:
        return None
    text = outcome.provenance.model_dump_json()
    if text not in work.provenances:
        content = outcome.provenance.model_dump(mode="json")
        work.provenances[text] = content_hash(content)
        insert_new(session, ProvenanceRow, {"hash": work.provenances[text], "content": content})
    return work.provenances[text]
