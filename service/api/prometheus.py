"""The gauges of the service as Prometheus reads them.

Each scrape reads the database; of this process alone are the write times and the open event streams.
"""

from collections.abc import Iterable, Iterator, Mapping

from fastapi import APIRouter, Request, Response
from prometheus_client import CollectorRegistry, Metric, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily
from prometheus_client.registry import Collector

from service.api.context import StoreHere
from service.db.engine import CLASSES_S
from service.db.tables import CAMPAIGN_STATES, ENDINGS, JOB_STATES
from service.store import Store
from service.store.statistics import Reading

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
    """Return what there is to do and how it ends; what has not occurred is 0, so that rates have a start."""
    return (
        _labelled(GaugeMetricFamily, "jobs", "Jobs", "state", JOB_STATES, reading.jobs),
        _labelled(GaugeMetricFamily, "campaigns", "Campaigns", "state", CAMPAIGN_STATES, reading.campaigns),
        _labelled(GaugeMetricFamily, "attempts", "Attempts", "ending", ("open", *ENDINGS), reading.attempts),
        _labelled(CounterMetricFamily, "solves", "Solves", "ending", ENDINGS, reading.solves),
        _labelled(
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


def _labelled(
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
