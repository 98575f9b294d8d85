"""One solution in full: flown for pictures and files, its lineage, and the job that found it."""

import json
from functools import lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Query
from fastapi.responses import StreamingResponse

from core.analysis.flight import Flight, fly
from core.problem import problem_from
from service.api.context import Hash, Limit, StoreHere
from service.api.export import CSV
from service.api.lineage_schemas import LineageGraph, Reproduction
from service.api.solution_files import state_lines, vector_lines
from service.dashboard.pictures import MOST_SAMPLES, flight_as_json
from service.store import UnknownRow
from workers.certificate import CertificateDocument

router = APIRouter(tags=["solutions"])

#: Children of a solution that are listed unless asked for otherwise.
MOST_CHILDREN = 50
EXPORT_EXAMPLE = (
    "# states and controls of solution 63dd0ec3...\ntrajectory,outage_segment,...\nreference,,...\n"
)


@router.get("/solutions/{solution_id}/trajectory")
def get_trajectory(
    solution_id: Hash,
    store: StoreHere,
    samples: Annotated[
        int,
        Query(
            ge=100,
            le=MOST_SAMPLES,
            description="Of all trajectories, about; those of a longer one are thinned",
        ),
    ] = MOST_SAMPLES,
    tracks: Annotated[
        Literal["all", "inertial"], Query(description="Positions in all frames, or in the inertial one alone")
    ] = "all",
) -> dict[str, Any]:
    """Return the solution flown: samples per trajectory [km, kg, days past departure], the Moon, the target.

    Those of a longer solution are thinned, arc by arc, and `n_samples` says how many there were.
    """
    definition, x = store.definition_and_vector(solution_id)
    return _pictured(json.dumps(definition), x.tobytes(), samples, tracks == "all")


@router.get("/solutions/{solution_id}/lineage")
def get_lineage(solution_id: Hash, store: StoreHere, children: Limit = MOST_CHILDREN) -> LineageGraph:
    """Return the seeds behind a solution, the best `children` that it seeded, and how to reproduce it."""
    return store.lineage(solution_id, children)


@router.get("/solutions/{solution_id}/reproduction")
def get_reproduction(solution_id: Hash, store: StoreHere) -> Reproduction:
    """Return the job that found a solution, as `coastarc solutions reproduce` runs it again."""
    return store.reproduction(solution_id)


@router.get("/solutions/{solution_id}/certificate")
def get_certificate(solution_id: Hash, store: StoreHere) -> CertificateDocument:
    """Return the certificate of a solution that was found last; 404 where nobody has verified it."""
    found = store.certificates.latest(solution_id)
    if found is None:
        advice = f"none; make it with `coastarc solutions verify {solution_id[:8]}`"
        raise UnknownRow("certificate of solution", solution_id, advice)
    return found


@router.get(
    "/solutions/{solution_id}/export",
    response_class=StreamingResponse,
    responses={200: {"content": {CSV: {"schema": {"type": "string"}, "example": EXPORT_EXAMPLE}}}},
)
def export_solution(
    solution_id: Hash,
    store: StoreHere,
    format: Literal["csv"] = "csv",
    what: Annotated[
        Literal["states", "vector"], Query(description="Samples in time, or the decision vector with bounds")
    ] = "states",
) -> StreamingResponse:
    """Return states and controls of the reference and all realizations, or the decision vector, as CSV."""
    definition, x = store.definition_and_vector(solution_id)
    problem = problem_from(definition)
    if what == "vector":
        lines = vector_lines(solution_id, problem, x)
    else:
        lines = state_lines(solution_id, problem, _flown(json.dumps(definition), x.tobytes()))
    name = f'attachment; filename="coastarc-{solution_id[:8]}-{what}.{format}"'
    return StreamingResponse(lines, media_type=CSV, headers={"Content-Disposition": name})


@lru_cache(maxsize=16)
def _flown(definition: str, vector: bytes) -> Flight:
    # Flying takes a second and a page asks for the same solution again and again.
    return fly(problem_from(json.loads(definition)), np.frombuffer(vector, dtype=np.float64))


@lru_cache(maxsize=64)
def _pictured(definition: str, vector: bytes, samples: int, has_frames: bool) -> dict[str, Any]:
    return flight_as_json(_flown(definition, vector), samples, has_frames)
