"""One solution in full: flown for pictures and files, its lineage, and the job that found it."""

import json
import time
from collections.abc import Iterable
from functools import lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, HTTPException, Query
from fastapi.responses import StreamingResponse

from core.analysis.flight import Flight, fly
from core.problem import problem_from
from service.api.context import Hash, Limit, StoreHere
from service.api.export import CSV
from service.api.solution_files import vector_lines
from service.dashboard.pictures import MOST_SAMPLES, flight_as_json
from service.schemas.solution import LineageGraph, Reproduction
from service.solutions import export as solution_export
from service.solutions.export import ALL, MEDIA, ZIP, ExportFormat, Wanted
from service.store import Store, UnknownRow
from workers.certify import CertificateDocument

router = APIRouter(tags=["solutions"])

#: Children of a solution that are listed unless asked for otherwise.
MOST_CHILDREN = 50
_TEXT, _BYTES = {"type": "string"}, {"type": "string", "format": "binary"}
#: What an export comes as, with its beginning.
EXPORTS: dict[str, Any] = {
    MEDIA[ExportFormat.SPK]: {"schema": _BYTES, "example": "DAF/SPK ..."},
    MEDIA[ExportFormat.OEM].split(";")[0]: {"schema": _TEXT, "example": "CCSDS_OEM_VERS = 2.0\n..."},
    ZIP: {"schema": _BYTES, "example": "PK..."},
    MEDIA[ExportFormat.CSV]: {"schema": _TEXT, "example": "# states and controls of solution 63dd0ec3...\n"},
    MEDIA[ExportFormat.NDJSON]: {"schema": _TEXT, "example": '{"trajectory": "reference", ...}\n'},
}


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
    responses={200: {"content": EXPORTS}},
)
def export_solution(
    solution_id: Hash,
    store: StoreHere,
    format: ExportFormat = ExportFormat.CSV,
    trajectory: Annotated[
        str,
        Query(
            pattern="^(all|reference|[1-9][0-9]{0,3})$",
            description="All, the reference, or the number of a realization",
        ),
    ] = ALL,
    what: Annotated[
        Literal["states", "vector"], Query(description="Samples in time, or (CSV alone) the decision vector")
    ] = "states",
) -> StreamingResponse:
    """Return states and controls of the reference and all realizations, or the decision vector with bounds.

    As SPICE kernel (`spk`), CCSDS message (`oem`; one for each trajectory, so all are a ZIP), CSV or NDJSON.
    """
    if what == "vector":
        return _vector(solution_id, store, format)
    record = store.record(solution_id)
    definition, _ = store.definition_and_vector(solution_id)
    created = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime())
    made = solution_export.export_solution(record, definition, Wanted(format, trajectory), created)
    return _download(made.content, made.media_type, made.name)


def _vector(solution_id: str, store: Store, format: ExportFormat) -> StreamingResponse:
    if format is not ExportFormat.CSV:
        raise HTTPException(422, f"format: expected csv for the decision vector, got {format}")
    definition, x = store.definition_and_vector(solution_id)
    lines = vector_lines(solution_id, problem_from(definition), x)
    return _download(lines, CSV, f"coastarc-{solution_id[:8]}-vector.csv")


def _download(content: Iterable[str] | Iterable[bytes], media_type: str, name: str) -> StreamingResponse:
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return StreamingResponse(content, media_type=media_type, headers=headers)


@lru_cache(maxsize=16)
def _flown(definition: str, vector: bytes) -> Flight:
    # Flying takes a second and a page asks for the same solution again and again.
    return fly(problem_from(json.loads(definition)), np.frombuffer(vector, dtype=np.float64))


@lru_cache(maxsize=64)
def _pictured(definition: str, vector: bytes, samples: int, has_frames: bool) -> dict[str, Any]:
    return flight_as_json(_flown(definition, vector), samples, has_frames)
