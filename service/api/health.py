"""Liveness, readiness, and metrics for Prometheus."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse
from prometheus_client import CollectorRegistry, Metric, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily
from prometheus_client.registry import Collector
from sqlalchemy.exc import SQLAlchemyError

from core.ephemeris.kernels import kernel_paths
from service.api.context import StoreHere
from service.db.engine import CLASSES_S
from service.db.errors import DatabaseError
from service.db.tables import CAMPAIGN_STATES, ENDINGS, JOB_STATES
from service.schemas.answer import Fault, Health
from service.store.statistics import Reading
from service.store.store import Store

router = APIRouter(tags=["health"])


#: The text format that every Prometheus reads.
MEDIA_TYPE = "text/plain; version=0.0.4; charset=utf-8"
EXAMPLE = """# HELP coastarc_jobs Jobs by state.
# TYPE coastarc_jobs gauge
coastarc_jobs{state="queued"} 256.0
"""


@router.get(
    "/metrics",
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}, "example": EXAMPLE}}}},
)
def metrics(store: StoreHere, request: Request) -> Response:
    """Return gauges and counters in the text format of Prometheus."""
    streams = getattr(request.app.state, "streams", None)
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Scrape(store, streams.n_open if streams is not None else 0))
    return Response(generate_latest(registry), media_type=MEDIA_TYPE)


class _Scrape(Collector):
    """One reading of a store."""

    def __init__(self, store: Store, n_streams: int) -> None:
        self._store = store
        self._n_streams = n_streams

    def collect(self) -> Iterator[Metric]:
        """Yield every family."""
        reading = self._store.gauges.read()
        yield from _work(reading)
        yield from _places(reading, self._n_streams)
        yield from _writes(*self._store.gauges.write_times)


def _work(reading: Reading) -> Iterable[Metric]:
    """Yield the metrics of jobs and solves; what has not occurred is 0, so that rates have a start."""
    return (
        _family(GaugeMetricFamily, "jobs", "Jobs", "state", JOB_STATES, reading.jobs),
        _family(GaugeMetricFamily, "campaigns", "Campaigns", "state", CAMPAIGN_STATES, reading.campaigns),
        _family(GaugeMetricFamily, "attempts", "Attempts", "ending", ("open", *ENDINGS), reading.attempts),
        _family(CounterMetricFamily, "solves", "Solves", "ending", ENDINGS, reading.solves),
        _family(
            CounterMetricFamily,
            "solve_cpu_seconds",
            "Processor time of solves [s]",
            "ending",
            ENDINGS,
            reading.solve_seconds,
        ),
    )


def _places(reading: Reading, n_streams: int) -> Iterable[Metric]:
    gauges = (
        (
            "oldest_lease_seconds",
            "Time since the oldest heartbeat of a running job [s].",
            reading.oldest_lease_s,
        ),
        ("workers_alive", "Dispatchers seen within the time of a lease.", reading.n_workers),
        ("worker_slots", "Jobs that these run at once.", reading.n_slots),
        ("solutions", "Different solutions in the archive.", reading.n_solutions),
        ("archive_bytes", "Size of the archive with its journal [byte].", reading.archive_bytes),
        ("event_streams", "Event streams that are open.", n_streams),
    )
    return [GaugeMetricFamily(f"coastarc_{name}", about, value=value) for name, about, value in gauges]


def _writes(counts: list[int], seconds: float, n_faults: int) -> Iterable[Metric]:
    ends = [*map(str, CLASSES_S), "+Inf"]
    totals = [float(sum(counts[: n + 1])) for n in range(len(counts))]
    times = HistogramMetricFamily("coastarc_write_seconds", "Write transactions of this process [s].")
    times.add_metric([], list(zip(ends, totals, strict=True)), seconds)
    faults = "Writes that the archive did not take."
    return times, CounterMetricFamily("coastarc_write_faults", faults, value=n_faults)


def _family(
    family: type[GaugeMetricFamily | CounterMetricFamily],
    name: str,
    things: str,
    label: str,
    values: Iterable[str],
    found: Mapping[str, float],
) -> Metric:
    metric = family(f"coastarc_{name}", f"{things} by {label}.", labels=[label])
    for value in values:
        metric.add_metric([value], found.get(value, 0))
    return metric


#: How long an answer about readiness stands [s]: anybody may ask, and to ask is to write.
KEPT_S = 2.0

CHECKS = {"archive": "ok", "dispatcher": "ok", "kernels": "ok"}
READY: dict[str, Any] = {"status": "ok", "checks": CHECKS}
NO_DISPATCHER = "expected one seen within 30 s, got none; start one with `coastarc dispatch`"
#: ... by a coordinator whose own should run.
NOT_STARTED = "the coordinator cannot start its own, got {}; it tries again by itself"


class Unready(Fault):
    """What is not ready, part by part."""

    checks: dict[str, str]


UNREADY = {
    "type": "about:blank",
    "title": "Service Unavailable",
    "status": 503,
    "detail": f"dispatcher: {NO_DISPATCHER}",
    "checks": CHECKS | {"dispatcher": NO_DISPATCHER},
}


@router.get(
    "/healthz",
    responses={200: {"content": {"application/json": {"example": {"status": "ok", "checks": {}}}}}},
)
def healthz() -> Health:
    """Return that the process answers."""
    return Health(status="ok", checks={})


@router.get(
    "/readyz",
    response_model=Health,
    responses={
        200: {"content": {"application/json": {"example": READY}}},
        503: {"model": Unready, "content": {"application/problem+json": {"example": UNREADY}}},
    },
)
def readyz(store: StoreHere, request: Request) -> Any:
    """Return whether the archive takes a write, a dispatcher was seen lately, and the kernels are there."""
    until, checks = getattr(request.app.state, "readiness", (0.0, {}))
    if time.monotonic() >= until:
        checks = _check(store, request.app.state.trouble())
        request.app.state.readiness = (time.monotonic() + KEPT_S, checks)
    faults = [f"{name}: {found}" for name, found in checks.items() if found != "ok"]
    if not faults:
        return Health(status="ok", checks=checks)
    body = Unready(title="Service Unavailable", status=503, detail="; ".join(faults), checks=checks)
    content = body.model_dump(exclude_none=True)
    return JSONResponse(content, status_code=503, media_type="application/problem+json")


def _check(store: Store, trouble: str | None) -> dict[str, str]:
    looks: dict[str, Callable[[Store], str]] = {
        "archive": _archive,
        "dispatcher": lambda store: _dispatcher(store, trouble),
        "kernels": _kernels,
    }
    return {name: look(store) for name, look in looks.items()}


def _archive(store: Store) -> str:
    try:
        store.check()
    except (DatabaseError, SQLAlchemyError):
        # Anybody may read this; where the archive is and what it said is in the log.
        return "expected to take a write, got a fault; see the log"
    return "ok"


def _dispatcher(store: Store, trouble: str | None) -> str:
    try:
        is_there = store.gauges.n_workers() > 0
    except (DatabaseError, SQLAlchemyError):
        return "expected an archive that tells, got a fault; see the log"
    if is_there:
        return "ok"
    said = NO_DISPATCHER.replace("30 s", f"{store.leases.lease_s:g} s")
    return said if trouble is None else f"{said.partition('; ')[0]}; {NOT_STARTED.format(trouble)}"


def _kernels(_: Store) -> str:
    missing = [path.name for path in kernel_paths() if not path.is_file()]
    return f"expected the SPICE kernels, got no {', '.join(missing)}" if missing else "ok"
