"""The filter of solutions as parameters of a query, the same for every route that lists solutions."""

from typing import Annotated

from fastapi import Depends, Query

from service.api.context import CampaignWanted, SearchWanted
from service.store.filter import Filter, Tolerance

_Strategy = Annotated[str | None, Query(pattern=r"^S\(\d{1,3}(\|\d{1,3})?\)$", description="As S(1|0)")]
_K = Annotated[int | None, Query(ge=0, le=1000, description="Number of outages survived")]
_Segment = Annotated[int | None, Query(ge=1, le=2000, description="Of an outage: the segment that it misses")]
_Duration = Annotated[
    float | None, Query(gt=0, le=1000, allow_inf_nan=False, description="Of the same outage: its length [d]")
]
_Tolerance = Annotated[
    Tolerance, Query(description="What is strict is good at the paper's tolerance as well")
]
_Bound = Annotated[float | None, Query(ge=0, le=1e6, allow_inf_nan=False)]


def _filter(
    campaign: CampaignWanted = None,
    search: SearchWanted = None,
    strict: Annotated[bool | None, Query(description="Only those that are, or are not, strict")] = None,
    strategy: _Strategy = None,
    k: _K = None,
    segment: _Segment = None,
    duration_days: _Duration = None,
    tolerance: _Tolerance = "all",
    min_delta_v_km_s: _Bound = None,
    max_delta_v_km_s: _Bound = None,
    min_time_of_flight_days: _Bound = None,
    max_time_of_flight_days: _Bound = None,
) -> Filter:
    return Filter(
        campaign,
        search,
        strict,
        strategy,
        k,
        segment,
        duration_days,
        tolerance,
        min_delta_v_km_s,
        max_delta_v_km_s,
        min_time_of_flight_days,
        max_time_of_flight_days,
    )


FilterWanted = Annotated[Filter, Depends(_filter)]
