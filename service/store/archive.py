"""Solves, solutions and the links to their seeds; a new solution plans the jobs that it seeds."""

import hashlib
from typing import Any

import numpy as np
from sqlalchemy import select
from sqlalchemy.orm import Session

from core.transcription import checked_vector, layout_of
from service.db.dialect import insert_new
from service.db.tables import CampaignRow, JobRow, SearchRow, SeedLinkRow, SolutionRow, SolveRow
from service.scheduler import plan
from service.store.events import note
from service.store.specs import search_spec, spec_of
from service.store.submission import add_job, progress_of
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
) -> None:
    """Store a solve and what it found, unless an earlier attempt had handed in the same hop."""
    solution_id = _add_solution(session, campaign, search, record, now)
    is_new = insert_new(session, SolveRow, _solve_values(job, record, solution_id, now))
    if solution_id is None or not is_new:
        return
    _announce(session, campaign, search, solution_id, now)
    if job.seed_id is not None and job.seed_id != solution_id:
        mapping = search_spec(campaign, search).mapping
        link = {"solution_id": solution_id, "seed_id": job.seed_id, "mapping": mapping}
        insert_new(session, SeedLinkRow, link)
    if record.certificate is not None and record.certificate.strict:
        _plan_seeded(session, campaign, search, solution_id, now)


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


def _add_solution(
    session: Session, campaign: CampaignRow, search: SearchRow, record: SolveRecord, now: float
) -> str | None:
    if record.x is None or record.trajectory is None or record.certificate is None:
        return None
    problem = spec_of(campaign).problem_of(search_spec(campaign, search))
    x = checked_vector(layout_of(problem), record.x)
    key = solution_hash(search.problem_hash, x)
    facts = record.trajectory.model_dump(exclude={"final_mass_kg"})
    insert_new(
        session,
        SolutionRow,
        facts
        | {
            "id": key,
            "problem_hash": search.problem_hash,
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
    session: Session, campaign: CampaignRow, search: SearchRow, solution_id: str, now: float
) -> None:
    """Plan the map jobs of every search that takes each seed at once."""
    for row in session.scalars(select(SearchRow).where(SearchRow.source_id == search.id)):
        spec = search_spec(campaign, row)
        is_open = row.state in ("waiting", "active")
        if spec.seeds is None or not spec.seeds.is_immediate or not is_open:
            continue
        if plan.is_exhausted(spec, progress_of(session, spec, row, False)):
            continue
        add_job(session, spec, row, plan.map_job(solution_id), now)
