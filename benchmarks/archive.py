"""A made-up archive of any size, to time what reads archives; its numbers mean nothing."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import typer
from numpy.typing import NDArray
from sqlalchemy import func, insert, select
from sqlalchemy.orm import Session

from benchmarks.load import PROVENANCE
from core.constants import SECONDS_PER_DAY
from core.epochs import calendar_epoch
from core.plain_data import content_hash
from service.db.dialect import FILL_TALLIES, TOTALS, insert_new, plain
from service.db.engine import URL_VARIABLE, Database, place_of
from service.db.tables import (
    AttemptRow,
    Base,
    EventRow,
    JobRow,
    ProvenanceRow,
    SearchRow,
    SolutionRow,
    SolveRow,
)
from service.spec import Spec
from service.spec.search_spec import SearchSpec
from service.store.events import event_of
from service.store.store import Store
from service.validation import facts_of, figures, solution_hash
from workers.messages import KIND_NUMBERS

#: Far beyond the chains that are planned when the campaign is submitted.
FIRST_CHAIN = 10**12
#: Rows that are inserted at once.
BATCH = 2000
#: Share of solves that are feasible, and of distinct ones among the solutions.
FEASIBLE, DISTINCT = 0.3, 0.5
PROVENANCE_HASH = content_hash(PROVENANCE)
#: Numbers that every solve has alike.
SOLVE = {
    "attempt": 1,
    "violation": 0.1,
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
}
ATTEMPT = {
    "attempt": 1,
    "worker": "nobody",
    "started_at": 0.0,
    "ended_at": 0.0,
    "next_state": "done",
    "error": None,
    "provenance_hash": PROVENANCE_HASH,
}
WHEN = {"created_at": 0.0, "updated_at": 0.0}


def require_folder(folder: Path) -> None:
    """Refuse to fill an archive that somebody lives on."""
    if not isinstance(place_of(folder), Path):
        raise typer.BadParameter(f"expected no database in {URL_VARIABLE}, got one; unset it")


def fill(folder: Path, spec: Spec, n_solves: int, rng: np.random.Generator, *, is_done: bool = True) -> int:
    """Store a campaign with so many made-up solves, shared out evenly among its searches; return its id.

    It has ended, or goes on from there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with Store(folder) as store:
        campaign_id, _ = store.submit(spec)
    database = Database(place_of(folder))
    shares = np.diff(np.linspace(0, n_solves, len(spec.search) + 1).astype(int))
    found: dict[str, list[str]] = {}
    for (position, search), share in zip(spec.in_order, shares, strict=True):
        seeds = found.get(search.seeds.source or "") if search.seeds else None
        maker = _Maker(spec, search, position, campaign_id, rng)
        found[search.id] = maker.store(database, int(share), seeds, is_done)
    database.write(_count)
    database.close()
    return campaign_id


def _count(session: Session) -> None:
    for statement in ("DELETE FROM tally", FILL_TALLIES, TOTALS):
        session.connection().exec_driver_sql(statement)


class _Maker:
    """Makes the rows of one search."""

    def __init__(
        self, spec: Spec, search: SearchSpec, position: int, campaign_id: int, rng: np.random.Generator
    ) -> None:
        self.search, self.position, self.rng = search, position, rng
        self.campaign_id = campaign_id
        self.rng_seed = spec.campaign.rng_seed
        self.facts = [facts_of(problem) for problem in spec.problems_of(search)]

    def store(self, database: Database, n_solves: int, seeds: list[str] | None, is_done: bool) -> list[str]:
        """Insert so many solves and return the ids of their solutions."""
        search_id, first_job = database.write(lambda session: self._begin(session, is_done))
        rows = self._rows(search_id, first_job, n_solves, seeds)
        found: list[str] = []
        while batch := list(islice(rows, BATCH)):
            found += database.write(lambda session, batch=batch: self._insert(session, search_id, batch))  # type: ignore[misc]
        return found

    def _begin(self, session: Session, is_done: bool) -> tuple[int, int]:
        own = (SearchRow.campaign_id == self.campaign_id) & (SearchRow.position == self.position)
        row = session.scalars(select(SearchRow).where(own)).one()
        row.state = "done" if is_done else row.state
        insert_new(session, ProvenanceRow, {"hash": PROVENANCE_HASH, "content": PROVENANCE})
        return row.id, 1 + (session.scalar(select(func.max(JobRow.id))) or 0)

    def _insert(self, session: Session, search_id: int, batch: list[Any]) -> list[str]:
        jobs, solutions, solves = zip(*batch, strict=True)
        new = [solution for solution in solutions if solution is not None]
        about = {"search": self.search.id, "search_id": search_id}
        events = [("job", {"job_id": job["id"], **about, "state": "done"}) for job in jobs]
        events += [("solution", {"id": one["id"], **about}) for one in new]
        tables: list[tuple[type[Base], list[dict[str, Any]]]] = [
            (JobRow, list(jobs)),
            (AttemptRow, [ATTEMPT | {"job_id": job["id"], "ending": job["ending"]} for job in jobs]),
            (SolutionRow, new),
            (SolveRow, list(solves)),
            (EventRow, [event_of(self.campaign_id, kind, 0.0, **data) for kind, data in events]),
        ]
        for table, rows in tables:
            if rows:
                session.connection().execute(insert(plain(table)), rows)
        return [solution["id"] for solution in new]

    def _rows(
        self, search_id: int, first_job: int, n: int, seeds: list[str] | None
    ) -> Iterator[tuple[dict[str, Any], dict[str, Any] | None, dict[str, Any]]]:
        centres = [self.rng.random(about.layout.n_variables) for about in self.facts]
        for number in range(n):
            case = number % len(self.facts)
            mapping = self.search.mapping[0] if seeds else None
            seed_id = seeds[number % len(seeds)] if seeds else None
            # The chain of a mapped seed is its hash; so often as it is mapped again, its hop differs.
            chain, hop = (seed_id, number // len(seeds)) if seeds else (f"{FIRST_CHAIN + number:032x}", 0)
            place = {
                "id": first_job + number,
                "search_id": search_id,
                "case_index": case,
                "chain": chain,
                "hop": hop,
            }
            seed = {"seed_id": seed_id, "mapping": mapping}
            kind = {"kind": "map" if seeds else "hop"}
            solution = self._solution(case, centres[case]) if self.rng.random() < FEASIBLE else None
            address = (KIND_NUMBERS[kind["kind"]], self.position, case, int(chain or "0", 16), hop)
            own = {
                "job_id": place["id"],
                "hop": hop,
                "rng_key": "/".join(map(str, (self.rng_seed, *address))),
                "move": None if seeds else "accepted",
                "defects": np.zeros(self.facts[case].n_defects),
            }
            solve = own | self._solve(search_id, solution)
            yield place | seed | kind | JOB | WHEN | {"ending": solve["ending"]}, solution, solve

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
            "final_mass_kg": solution["objective_kg"] if solution else None,
        }

    def _solution(self, case: int, centre: NDArray[np.float64]) -> dict[str, Any]:
        is_new = self.rng.random() < DISTINCT
        place = self.rng.random(len(centre)) if is_new else centre + 1e-3 * self.rng.random(len(centre))
        about = self.facts[case]
        (lower, upper), own = about.bounds, about.layout.reference
        x = lower + (upper - lower) * place
        x[own.final_mass] = self.rng.uniform(0.94, 0.987) * about.start_mass_kg
        said = figures(about, x)
        arrival = about.start_et + said["time_of_flight_days"] * SECONDS_PER_DAY
        return said | {
            "id": solution_hash(about.hash, x),
            "problem_hash": about.hash,
            "x": x,
            "insertion_epoch": calendar_epoch(arrival - said["final_coast_days"] * SECONDS_PER_DAY),
            "arrival_epoch": calendar_epoch(arrival),
            "defects": np.zeros(about.n_defects),
            "paper": True,
            "strict": True,
            "verification": {},
            "created_at": 0.0,
        }
