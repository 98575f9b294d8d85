"""Solutions: lists and records; what one of them looks like is in `service.api.flights`."""

from typing import Annotated, Any, Literal

from fastapi import APIRouter, HTTPException, Query
from fastapi.responses import StreamingResponse

from service.api.context import Hash, Limit, StoreHere
from service.api.export import CSV, NDJSON, begun, csv_lines, ndjson_lines
from service.api.solution_filter import FilterWanted
from service.schemas.solution import RecordInFull, RecordPage
from service.store.filters import Begin, Order, Sort

router = APIRouter(tags=["solutions"])

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
