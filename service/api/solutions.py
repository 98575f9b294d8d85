"""Solutions: lists, records, trajectories for pictures, lineages."""

import json
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query

from core.analysis.flight import fly
from core.problem import problem_from
from service.api.context import CampaignWanted, Hash, Limit, SearchWanted, StoreHere
from service.api.schemas import Lineage, RecordPage, RecordWithVector
from service.dashboard.pictures import flight_as_json
from service.store.records import Filter

router = APIRouter(tags=["solutions"])


@router.get("/solutions")
def list_solutions(
    store: StoreHere,
    campaign: CampaignWanted = None,
    search: SearchWanted = None,
    strict: bool | None = None,
    limit: Limit = 50,
    after: Annotated[str | None, Query(max_length=80, description="`next` of the page before")] = None,
) -> RecordPage:
    """Return solutions, the most final mass first."""
    return store.records(Filter(campaign, search, strict), limit, after)


@router.get("/solutions/{solution_id}")
def get_solution(solution_id: Hash, store: StoreHere) -> RecordWithVector:
    """Return a solution with its decision vector."""
    return store.record(solution_id)


@router.get("/solutions/{solution_id}/trajectory")
def get_trajectory(solution_id: Hash, store: StoreHere) -> dict[str, Any]:
    """Return the solution flown: samples per trajectory [km, kg, TDB s past J2000], the Moon, the target."""
    definition, x = store.definition_and_vector(solution_id)
    return _flown(json.dumps(definition), x.tobytes())


@router.get("/solutions/{solution_id}/lineage")
def get_lineage(solution_id: Hash, store: StoreHere) -> Lineage:
    """Return the seeds behind a solution, and the seeds of those."""
    return store.lineage(solution_id)


@lru_cache(maxsize=64)
def _flown(definition: str, vector: bytes) -> dict[str, Any]:
    # Flying takes a second and a page asks for the same solution again and again.
    flight = fly(problem_from(json.loads(definition)), np.frombuffer(vector, dtype=np.float64))
    return flight_as_json(flight)
