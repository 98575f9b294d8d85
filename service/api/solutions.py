"""Routes of solutions: lists, points, clusters, details, trajectories, exports, lineage, missed thrust."""

import json
import time
from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import chain, islice
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Depends, HTTPException, Query
from fastapi.responses import StreamingResponse

from core.analysis.flight import Flight, fly
from core.analysis.similarity import DISTINCT
from core.csv_text import csv_text, without_formula
from core.problem import problem_from
from service.api.context import CampaignWanted, Hash, Limit, StoreHere
from service.api.vector_files import vector_lines
from service.dashboard.pictures import MOST_SAMPLES, flight_as_json
from service.schemas.solution import (
    ChoicesView,
    ClusterPage,
    Filter,
    LineageGraph,
    MissedThrustPage,
    PointsView,
    Record,
    RecordInFull,
    RecordPage,
    RecordWithVector,
    Reproduction,
)
from service.solutions import export as solution_export
from service.solutions.export import ALL, MEDIA, ZIP, ExportFormat, Wanted
from service.solutions.missed_thrust import views_of
from service.store.errors import UnknownRowError
from service.store.filters import Begin, Order, Sort
from service.store.store import Store
from workers.certificate import CertificateDocument

router = APIRouter(tags=["solutions"])


def _filter(wanted: Annotated[Filter, Query()]) -> Filter:
    # Of its own, since parameters are taken from the fields of a model where it is the only one.
    return wanted


FilterWanted = Annotated[Filter, Depends(_filter)]


#: Points that a page can draw.
MOST_POINTS = 5000


@router.get("/solutions/points")
def list_points(
    store: StoreHere,
    wanted: FilterWanted,
    most: Annotated[int, Query(ge=100, le=MOST_POINTS, description="Points at most")] = MOST_POINTS,
) -> PointsView:
    """Return solutions as points, downsampled with the extremes and the Pareto front kept."""
    return store.points(wanted, most)


@router.get("/solutions/clusters")
def list_clusters(
    store: StoreHere,
    wanted: FilterWanted,
    threshold: Annotated[
        float, Query(ge=0, le=10, allow_inf_nan=False, description="Greatest distance in a cluster [-]")
    ] = DISTINCT,
    limit: Annotated[int, Query(ge=1, le=200)] = 50,
) -> ClusterPage:
    """Return which solutions are alike, among the 2,000 with the least delta-v."""
    return store.clusters(wanted, threshold, limit)


@router.get("/solutions/choices")
def list_choices(store: StoreHere, campaign: CampaignWanted = None) -> ChoicesView:
    """Return the campaigns, and the searches, strategies and outages that a filter can name."""
    return store.choices(campaign)


CSV = "text/csv"
NDJSON = "application/x-ndjson"

#: What has no place in a cell.
_NESTED = {"defects_solved", "defects_verified", "package_versions", "kernel_hashes"}
#: As in RFC 4180: what a worker says may hold a carriage return.
_LINE_END = "\r\n"
COLUMNS = tuple(name for name in Record.model_fields if name not in _NESTED)


def csv_lines(pages: Iterable[list[RecordWithVector]]) -> Iterator[str]:
    """Yield the title line, then each page; outages are written 24:1.0 40:1.0, segment and days."""
    yield csv_text([COLUMNS], _LINE_END)
    for page in pages:
        rows = ([_cell(getattr(record, name)) for name in COLUMNS] for record in page)
        yield csv_text(rows, _LINE_END)


def ndjson_lines(pages: Iterable[list[RecordWithVector]]) -> Iterator[str]:
    """Yield each page, one record a line."""
    for page in pages:
        yield "".join(record.model_dump_json() + "\n" for record in page)


def begun(pieces: Iterator[str]) -> Iterator[str]:
    """Return the chunks with the first one computed, so that a failure before it is an error response."""
    return chain(list(islice(pieces, 2)), pieces)


def _cell(value: Any) -> Any:
    if isinstance(value, list):
        return " ".join(f"{outage.segment}:{outage.duration_days}" for outage in value)
    if isinstance(value, str):
        # Names are harmless; what a worker says about itself may be anything.
        return without_formula(value)
    return value.isoformat() if hasattr(value, "isoformat") else value


#: Solutions on a page unless asked for otherwise.
PAGE = 50
CSV_EXAMPLE = "id,campaign_id,search,...\n63dd0ec3...,1,s0,...\n"
NDJSON_EXAMPLE = '{"id": "63dd0ec3...", "campaign_id": 1, "x": [38.2, 0.4]}\n'


@router.get(
    "/solutions",
    response_model=RecordPage,
    responses={
        200: {
            "content": {
                CSV: {"schema": {"type": "string"}, "example": CSV_EXAMPLE},
                NDJSON: {"schema": {"type": "string"}, "example": NDJSON_EXAMPLE},
            }
        }
    },
)
def list_solutions(
    store: StoreHere,
    wanted: FilterWanted,
    sort: Sort = "objective_kg",
    descending: Annotated[
        bool | None, Query(description="Which way round; what is most wanted comes first if left out")
    ] = None,
    format: Literal["json", "csv", "ndjson"] = "json",
    limit: Limit | None = None,
    after: Annotated[str | None, Query(max_length=80, description="`next` of the page before")] = None,
    begin: Annotated[
        float | None, Query(allow_inf_nan=False, description="Value of `sort` at which the page begins")
    ] = None,
) -> Any:
    """Return solutions: as `json` a page, the most final mass first; as `csv` or `ndjson` all, by id.

    NDJSON has every field and the decision vector, CSV the plain ones.  A download may take as long as it
    likes and holds nothing up; one that breaks off lacks the end that HTTP promises.
    """
    if format == "json":
        return store.records(wanted, limit or PAGE, Begin(after, begin), Order(sort, descending))
    if (limit, after, begin) != (None, None, None):
        raise HTTPException(
            422, f"format {format}: expected neither limit nor after, got one; it has them all"
        )
    pages = store.record_pages(wanted)
    name = {"Content-Disposition": f'attachment; filename="solutions.{format}"'}
    if format == "csv":
        return StreamingResponse(begun(csv_lines(pages)), media_type=CSV, headers=name)
    return StreamingResponse(begun(ndjson_lines(pages)), media_type=NDJSON, headers=name)


@router.get("/solutions/{solution_id}")
def get_solution(solution_id: Hash, store: StoreHere) -> RecordInFull:
    """Return a solution with its decision vector."""
    return store.record(solution_id)


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
    """Return the propagated trajectories [km, kg, days past departure], the Moon's path and the target's.

    Those of a longer solution are thinned, arc by arc, and `n_samples` says how many there were.
    """
    definition, x = store.definition_and_vector(solution_id)
    return _picture(json.dumps(definition), x, samples, tracks == "all")


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
        raise UnknownRowError("certificate of solution", solution_id, advice)
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
    lines = vector_lines(solution_id, problem_from(definition), np.array(x))
    return _download(lines, CSV, f"coastarc-{solution_id[:8]}-vector.csv")


def _download(content: Iterable[str] | Iterable[bytes], media_type: str, name: str) -> StreamingResponse:
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return StreamingResponse(content, media_type=media_type, headers=headers)


@lru_cache(maxsize=16)
def _propagate(definition: str, vector: tuple[float, ...]) -> Flight:
    # Flying takes a second and a page asks for the same solution again and again.
    return fly(problem_from(json.loads(definition)), np.array(vector))


@lru_cache(maxsize=64)
def _picture(definition: str, vector: tuple[float, ...], samples: int, has_frames: bool) -> dict[str, Any]:
    return flight_as_json(_propagate(definition, vector), samples, has_frames)


@router.get("/solutions/{solution_id}/missed-thrust")
def list_missed_thrust(
    solution_id: Hash,
    store: StoreHere,
    campaign: CampaignWanted = None,
    limit: Annotated[int, Query(ge=1, le=10)] = 1,
) -> MissedThrustPage:
    """Return the newest missed-thrust analyses of a solution, or that of one campaign, finished or not."""
    return MissedThrustPage(items=views_of(store, solution_id, campaign, limit))
