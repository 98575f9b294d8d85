"""A made-up archive of any size, to time what reads archives; its numbers mean nothing."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import insert, select
from sqlalchemy.orm import Session

from core.transcription import layout_of
from service.db.engine import Database
from service.db.place import place_of
from service.db.tables import AttemptRow, JobRow, ProvenanceRow, SearchRow, SolutionRow, SolveRow
from service.search_spec import SearchSpec
from service.spec import Spec
from service.store import Store
from service.store.archive import solution_hash

#: Far beyond the chains that are planned when the campaign is submitted.
FIRST_CHAIN = 10**12
#: Rows that are inserted at once.
BATCH = 2000
#: Mass at departure [kg].
START_MASS_KG = 13_276.04
#: Share of solves that are feasible, and of distinct ones among the solutions.
FEASIBLE, DISTINCT = 0.3, 0.5
#: Numbers that every solve has alike.
SOLVE = {
    "attempt": 1,
    "hop": 0,
    "rng_key": "made/up",
    "violation": 0.1,
    "defects": np.zeros(7),
    "n_iterations": 100,
    "n_evaluations": 200,
    "created_at": 0.0,
}
JOB = {
    "n_hops": 1,
    "state": "done",
    "priority": 0,
    "attempt": 1,
    "n_failures": 0,
    "ending": "feasible",
}
WHEN = {"created_at": 0.0, "updated_at": 0.0}
PROVENANCE = {"code_version": "0", "package_versions": {}, "kernel_hashes": {}, "host": "made up"}
ATTEMPT = {
    "attempt": 1,
    "worker": "made up",
    "started_at": 0.0,
    "ended_at": 5.0,
    "ending": "feasible",
    "next_state": "done",
    "provenance_hash": "made up",
}


def fill(folder: Path, spec: Spec, n_solves: int, rng: np.random.Generator) -> int:
    """Store a campaign with so many made-up solves, shared out evenly among its searches; return its id."""
    with Store(folder) as store:
        campaign_id, _ = store.submit(spec)
    database = Database(place_of(folder))
    database.write(lambda session: session.add(ProvenanceRow(hash="made up", content=PROVENANCE)))
    shares = np.diff(np.linspace(0, n_solves, len(spec.search) + 1).astype(int))
    found: dict[str, list[str]] = {}
    for (position, search), share in zip(spec.in_order, shares, strict=True):
        seeds = found.get(search.seeds.source) if search.seeds else None
        maker = _Maker(spec, search, position, rng)
        found[search.id] = database.write(
            lambda session, maker=maker, seeds=seeds, n=int(share): maker.store(session, n, seeds)  # type: ignore[misc]
        )
    database.close()
    return campaign_id


class _Maker:
    """Makes the rows of one search."""

    def __init__(self, spec: Spec, search: SearchSpec, position: int, rng: np.random.Generator) -> None:
        self.search, self.position, self.rng = search, position, rng
        self.problems = spec.problems_of(search)
        self.hashes = [problem.hash for problem in self.problems]
        self.boxes = [layout_of(problem).bounds(problem, START_MASS_KG) for problem in self.problems]

    def store(self, session: Session, n_solves: int, seeds: list[str] | None) -> list[str]:
        """Insert so many solves and return the ids of their solutions."""
        row = session.scalar(select(SearchRow).where(SearchRow.position == self.position))
        assert row is not None
        row.state = "done"
        found: list[str] = []
        rows = list(self._rows(row.id, n_solves, seeds))
        for start in range(0, len(rows), BATCH):
            jobs, solutions, solves = zip(*rows[start : start + BATCH], strict=True)
            ids = session.scalars(
                insert(JobRow).returning(JobRow.id, sort_by_parameter_order=True), jobs
            ).all()
            session.execute(insert(AttemptRow), [ATTEMPT | {"job_id": job} for job in ids])
            new = [solution for solution in solutions if solution is not None]
            if new:
                session.execute(insert(SolutionRow), new)
            session.execute(
                insert(SolveRow), [solve | {"job_id": job} for solve, job in zip(solves, ids, strict=True)]
            )
            found += [solution["id"] for solution in new]
        return found

    def _rows(
        self, search_id: int, n: int, seeds: list[str] | None
    ) -> Iterator[tuple[dict[str, Any], dict[str, Any] | None, dict[str, Any]]]:
        centres = [self.rng.random(len(lower)) for lower, _ in self.boxes]
        for number in range(n):
            case = number % len(self.problems)
            mapping = self.search.mapping[0] if seeds else None
            seed_id = seeds[number % len(seeds)] if seeds else None
            # The chain of a mapped seed is its hash; so often as it is mapped again, its hop differs.
            chain, hop = (seed_id, number // len(seeds)) if seeds else (f"{FIRST_CHAIN + number:032x}", 0)
            place = {"search_id": search_id, "case_index": case, "chain": chain, "hop": hop}
            seed = {"seed_id": seed_id, "mapping": mapping}
            kind = {"kind": "map" if seeds else "hop"}
            solution = self._solution(case, centres[case]) if self.rng.random() < FEASIBLE else None
            yield place | seed | kind | JOB | WHEN, solution, self._solve(search_id, solution)

    def _solve(self, search_id: int, solution: dict[str, Any] | None) -> dict[str, Any]:
        is_found = solution is not None
        return SOLVE | {
            "search_id": search_id,
            "ending": "feasible" if is_found else "infeasible",
            "status": "OPTIMAL" if is_found else "STALLED",
            "is_feasible": is_found,
            "paper": is_found,
            "strict": is_found,
            "objective_kg": solution["objective_kg"] if solution else None,
            "cpu_seconds": float(self.rng.exponential(5.0)),
            "wall_seconds": 5.0,
            "solution_id": solution["id"] if solution else None,
        }

    def _solution(self, case: int, centre: NDArray[np.float64]) -> dict[str, Any]:
        is_new = self.rng.random() < DISTINCT
        place = self.rng.random(len(centre)) if is_new else centre + 1e-3 * self.rng.random(len(centre))
        lower, upper = self.boxes[case]
        x = lower + (upper - lower) * place
        mass = float(self.rng.uniform(12_500, 13_100))
        shooting, first, last = self.rng.uniform((40.0, 0.0, 1.0), (90.0, 9.0, 9.0)).tolist()
        return {
            "id": solution_hash(self.hashes[case], x),
            "problem_hash": self.hashes[case],
            "x": x,
            "objective_kg": mass,
            "propellant_kg": START_MASS_KG - mass,
            "delta_v_km_s": float(26.55465 * np.log(START_MASS_KG / mass)),
            "delta_v_total_km_s": float(26.55465 * np.log(15_000 / mass)),
            "shooting_days": shooting,
            "initial_coast_days": first,
            "final_coast_days": last,
            "time_of_flight_days": first + shooting + last,
            "insertion_epoch": "2026-06-06T00:00:00.000",
            "arrival_epoch": "2026-06-08T00:00:00.000",
            "defects": np.zeros(7),
            "paper": True,
            "strict": True,
            "verification": {},
            "created_at": 0.0,
        }
