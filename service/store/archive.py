"""Solves, solutions and the links to their seeds; a new solution plans the jobs that it seeds."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from sqlalchemy import bindparam, select
from sqlalchemy.orm import Session

from service.db.dialect import insert_new
from service.db.tables import CampaignRow, JobRow, SearchRow, SeedLinkRow, SolutionRow, SolveRow
from service.db.transitions import ENDED
from service.scheduler import plan
from service.store.events import noted
from service.store.held import Held, Worked
from service.store.specs import search_spec, spec_of
from service.store.submission import add_jobs, is_used_up
from service.store.tallies import Counts, scope_of
from service.validation import solution_hash
from workers.job import SolveRecord

#: The searches that take the seeds of one, with their campaigns.
_FED = (
    select(SearchRow, CampaignRow)
    .join(CampaignRow, CampaignRow.id == SearchRow.campaign_id)
    .where(SearchRow.source_id == bindparam("source_id"))
    .order_by(SearchRow.id)
)
#: Fields of a record that a row takes over as they are.
COPIED = (
    "hop",
    "rng_key",
    "status",
    "is_feasible",
    "objective_kg",
    "violation",
    "n_iterations",
    "n_evaluations",
    "cpu_seconds",
    "wall_seconds",
    "move",
)


def add_solve(
    session: Session, held: Held, work: Worked, record: SolveRecord, counts: Counts, now: float
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
    work.events.append(_announced(held, record, solution_id, now))
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
    session: Session, held: Held, record: SolveRecord, now: float
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


def _announced(held: Held, record: SolveRecord, solution_id: str, now: float) -> dict[str, Any]:
    assert record.trajectory is not None and record.certificate is not None
    return noted(
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
    session: Session, held: Held, work: Worked, record: SolveRecord, solution_id: str, now: float
) -> None:
    """Plan the map jobs of every search that takes each seed at once."""
    assert record.trajectory is not None and record.certificate is not None
    job = held.job
    seed = plan.Candidate(
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
            if add_jobs(session, search, row, plan.map_jobs(spec_of(owner), search, seed), now):
                work.fed[row.id] = row, owner


def _takers(session: Session, work: Worked) -> Sequence[tuple[SearchRow, CampaignRow]]:
    """Return the searches that take seeds of this one, with their campaigns: another may feed on it."""
    if work.takers is None:
        # What is pending says nothing about them, and is stored together at the end.
        with session.no_autoflush:
            found = session.execute(_FED, {"source_id": work.search.id})
            work.takers = [(row, owner) for row, owner in found]
    return work.takers
