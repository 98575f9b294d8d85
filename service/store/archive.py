"""Solves, solutions and the links to their seeds; a new solution plans the jobs that it seeds."""

import hashlib
from typing import Any

import numpy as np
from sqlalchemy import select
from sqlalchemy.orm import Session

from core.problem import problem_from
from core.transcription import checked_vector, layout_of
from service.db.dialect import insert_new
from service.db.tables import (
    CampaignRow,
    CaseRow,
    JobRow,
    ProblemRow,
    SearchRow,
    SeedLinkRow,
    SolutionRow,
    SolveRow,
)
from service.scheduler import plan
from service.scheduler.states import ENDED
from service.store.events import note
from service.store.specs import search_spec, spec_of
from service.store.submission import add_jobs, progress_of
from workers.job import SolveRecord

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


def solution_hash(problem_hash: str, x: Any) -> str:
    """Return the identity of a solution: its problem and every bit of its vector."""
    vector = np.ascontiguousarray(x, dtype="<f8")
    return hashlib.blake2b(bytes.fromhex(problem_hash) + vector.tobytes(), digest_size=16).hexdigest()


def add_solve(
    session: Session, campaign: CampaignRow, search: SearchRow, job: JobRow, record: SolveRecord, now: float
) -> bool:
    """Store a solve and what it found, unless an earlier attempt had handed in the same hop; tell which."""
    solution_id = _add_solution(session, job, record, now)
    is_new = insert_new(session, SolveRow, _solve_values(job, record, solution_id, now))
    if solution_id is None or not is_new:
        return is_new
    _announce(session, campaign, search, solution_id, now)
    if job.seed_id is not None and job.seed_id != solution_id:
        link = {"solution_id": solution_id, "seed_id": job.seed_id, "mapping": job.mapping}
        insert_new(session, SeedLinkRow, link)
    _plan_seeded(session, campaign, job, record, solution_id, now)
    return True


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
        "created_at": now,
    }


def _add_solution(session: Session, job: JobRow, record: SolveRecord, now: float) -> str | None:
    if record.x is None or record.trajectory is None or record.certificate is None:
        return None
    case = session.get_one(CaseRow, (job.search_id, job.case_index))
    definition = session.get_one(ProblemRow, case.problem_hash).definition
    x = checked_vector(layout_of(problem_from(definition)), record.x)
    key = solution_hash(case.problem_hash, x)
    facts = record.trajectory.model_dump(exclude={"final_mass_kg"})
    insert_new(
        session,
        SolutionRow,
        facts
        | {
            "id": key,
            "problem_hash": case.problem_hash,
            "x": x,
            "objective_kg": record.trajectory.final_mass_kg,
            "defects": _flat(record.certificate.defects),
            "paper": record.certificate.paper,
            "strict": record.certificate.strict,
            "verification": record.certificate.details,
            "created_at": now,
        },
    )
    return key


def _flat(defects: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    # None, which stands for what was not finite, becomes NaN here.
    return np.array(defects, dtype=np.float64).ravel()


def _announce(
    session: Session, campaign: CampaignRow, search: SearchRow, solution_id: str, now: float
) -> None:
    solution = session.get_one(SolutionRow, solution_id)
    note(
        session,
        campaign.id,
        "solution",
        now,
        id=solution_id,
        search=search.name,
        search_id=search.id,
        delta_v_km_s=solution.delta_v_km_s,
        propellant_kg=solution.propellant_kg,
        strict=solution.strict,
    )


def _plan_seeded(
    session: Session, campaign: CampaignRow, job: JobRow, record: SolveRecord, solution_id: str, now: float
) -> None:
    """Plan the map jobs of every search that takes each seed at once."""
    assert record.trajectory is not None and record.certificate is not None
    seed = plan.Candidate(
        solution_id,
        (job.case_index, job.chain, record.hop),
        search_spec(campaign, session.get_one(SearchRow, job.search_id)).outage_sets[job.case_index],
        record.trajectory.delta_v_km_s,
        record.trajectory.time_of_flight_days,
    )
    for row in session.scalars(select(SearchRow).where(SearchRow.source_id == job.search_id)):
        # Another campaign may feed on this one.
        owner = session.get_one(CampaignRow, row.campaign_id)
        search = search_spec(owner, row)
        if search.seeds is None or not search.is_immediate or row.state in ENDED:
            continue
        is_good = record.certificate.strict or search.seeds.tolerance == "paper"
        if is_good and not plan.is_exhausted(search, progress_of(session, search, row, False)):
            add_jobs(session, search, row, plan.map_jobs(spec_of(owner), search, seed), now)
