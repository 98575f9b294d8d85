"""What users feel while workers are busy: the times of reads and of submissions."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import cycle, islice

import httpx

from service.spec import spec_from

#: Reads that pages and commands make; {campaign} is the busy one.
READS = (
    "/api/v1/campaigns",
    "/api/v1/campaigns/{campaign}",
    "/api/v1/solutions?campaign={campaign}&limit=20",
    "/api/v1/jobs?campaign={campaign}&limit=50",
    "/api/v1/events?campaign={campaign}&after={event}&limit=200",
    "/api/v1/workers",
    "/metrics",
)


@dataclass(slots=True)
class Latency:
    """Times of requests [s]."""

    reads: dict[str, list[float]] = field(default_factory=dict)
    submits: list[float] = field(default_factory=list)
    n_refused: int = 0

    def all_reads(self) -> list[float]:
        """Return the times of all reads together."""
        return [seconds for times in self.reads.values() for seconds in times]


class Probe:
    """Asks one thing after the other, and takes the time."""

    def __init__(self, client: httpx.Client, campaign_id: int) -> None:
        self._client = client
        self.campaign_id = campaign_id
        self._event = 0
        self._turns: Iterator[str] = cycle(READS)
        self._n_submits = 0
        self.felt = Latency()

    def read(self) -> None:
        """Make the read whose turn it is."""
        (template,) = islice(self._turns, 1)
        begin = time.perf_counter()
        answer = self._client.get(template.format(campaign=self.campaign_id, event=self._event))
        self._took(self.felt.reads.setdefault(template, []), begin, answer)
        if template.startswith("/api/v1/events") and answer.is_success and (items := answer.json()["items"]):
            self._event = items[-1]["id"]

    def submit(self) -> None:
        """Submit a small campaign that nobody has submitted before."""
        self._n_submits += 1
        body = spec_from(campaign(f"probe {self._n_submits}", 1, self._n_submits)).as_fields()
        begin = time.perf_counter()
        self._took(self.felt.submits, begin, self._client.post("/api/v1/campaigns", json=body))

    def _took(self, times: list[float], begin: float, answer: httpx.Response) -> None:
        times.append(time.perf_counter() - begin)
        self.felt.n_refused += not answer.is_success


def campaign(name: str, guesses: int, rng_seed: int) -> dict[str, object]:
    """Return a campaign whose solutions become seeds at once."""
    return {
        "campaign": {"name": name, "rng_seed": rng_seed},
        "problem": {"preset": "ppe-drm3"},
        "search": [
            {"id": "s0", "strategy": "S(0)", "guesses": guesses, "hops": 1},
            {
                "id": "s1-0",
                "strategy": "S(1|0)",
                "outages": [{"segment": 24, "duration_days": 1.0}],
                "seeds": {"from": "s0"},
            },
        ],
    }


def percentile_ms(times: Sequence[float], share: float) -> float | None:
    """Return the time that a share of all did not exceed [ms], or None of none."""
    if not times:
        return None
    ordered = sorted(times)
    return 1e3 * ordered[min(len(ordered) - 1, int(share * len(ordered)))]
