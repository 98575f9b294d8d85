"""One measurement of the service: a coordinator, simulated workers, and probes beside them."""

import json
import multiprocessing
import platform
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import psutil

from benchmarks.archive import fill
from benchmarks.load import Load, Tally, run_workers
from benchmarks.probe import Probe, campaign, percentile_ms
from benchmarks.readers import ReadersTally, run_readers
from service.coordinator import CoordinatorError
from service.spec import spec_from
from workers.messages import WorkerInfo
from workers.provenance import code_version

READ_PERIOD_S = 0.1
SUBMIT_PERIOD_S = 5.0
SAMPLES = 20


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is to be measured."""

    n_outcomes: int
    n_workers: int
    n_slots: int
    seconds: float
    rate_per_s: float
    feasible_share: float
    #: Made-up outcomes that are in the archive before.
    n_before: int = 0
    #: Readers that ask without a pause, a quarter of them for metrics.
    n_readers: int = 0


def measure(folder: Path, wanted: Wanted) -> dict[str, Any]:
    """Return what the coordinator did with the load; the archive stays in the folder."""
    spec = campaign("bench", 10_000_000, 1)
    if wanted.n_before:
        fill(folder, spec_from(spec), wanted.n_before, np.random.default_rng(1), is_done=False)
    with (
        _server(folder, wanted.n_readers) as (process, told),
        httpx.Client(base_url=told["url"], timeout=120) as client,
    ):
        answer = client.post("/api/v1/campaigns", json=spec_from(spec).as_fields(), timeout=600)
        if answer.is_error:
            raise CoordinatorError(f"bench: expected a campaign, got {answer.text[:300]}")
        info = WorkerInfo(
            name="simulated",
            host="localhost",
            executor="inline",
            slots=1,
            code_version=code_version(),
            python_version=platform.python_version(),
        )
        load = Load(
            told["url"],
            told["token"],
            info,
            wanted.n_workers,
            wanted.n_slots,
            wanted.rate_per_s,
            wanted.feasible_share,
        )
        probe = Probe(client, answer.json()["id"])
        with _reading(told, probe.campaign_id) as readers:
            measured = _under_load(folder, psutil.Process(process.pid), load, probe, wanted)
    return measured | {"readers": _of_readers(readers)}


@contextmanager
def _reading(told: dict[str, Any], campaign_id: int) -> Iterator[list[ReadersTally]]:
    """Let readers ask all the while; what they met is in the list afterwards."""
    found: list[ReadersTally] = []
    if not told["readers"]:
        yield found
        return
    context = multiprocessing.get_context("spawn")
    stop, results = context.Event(), context.Queue()
    order = (told["url"], told["readers"], campaign_id, stop, results)
    readers = context.Process(target=run_readers, args=order, daemon=True)
    readers.start()
    try:
        yield found
    finally:
        stop.set()
    found.append(results.get(timeout=300))
    readers.join(60)


def _of_readers(found: list[ReadersTally]) -> dict[str, Any] | None:
    if not found:
        return None
    (tally,) = found
    reads = {name: _times(times) for name, times in tally.reads.items()}
    return {"reads": reads, "statuses": dict(sorted(tally.statuses.items()))}


@contextmanager
def _server(folder: Path, n_readers: int) -> Iterator[tuple["subprocess.Popen[str]", dict[str, Any]]]:
    folder.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "benchmarks.server", str(folder), str(n_readers)]
    with open(folder / "server.log", "w", encoding="utf-8") as log:
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True
        )
    assert process.stdout is not None and process.stdin is not None
    try:
        line = process.stdout.readline()
        if not line:
            raise CoordinatorError(f"bench: expected a coordinator, got none; see {folder / 'server.log'}")
        yield process, json.loads(line)
    finally:
        process.stdin.close()
        try:
            process.wait(30)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()


def _under_load(
    folder: Path, server: psutil.Process, load: Load, probe: Probe, wanted: Wanted
) -> dict[str, Any]:
    context = multiprocessing.get_context("spawn")
    n_done, stop, results = context.Value("q", 0), context.Event(), context.Queue()
    workers = context.Process(target=run_workers, args=(load, n_done, stop, results), daemon=True)
    workers.start()
    try:
        while not n_done.value and workers.is_alive():
            time.sleep(0.05)
        before = _state(folder, server, n_done.value, [])
        samples = _watch(folder, server, probe, wanted, n_done)
    finally:
        stop.set()
    tally: Tally = results.get(timeout=300)
    workers.join(60)
    after = _state(folder, server, n_done.value, [])
    return _report(folder, probe, tally, before, after, samples)


def _watch(
    folder: Path, server: psutil.Process, probe: Probe, wanted: Wanted, n_done: Any
) -> list[dict[str, Any]]:
    """Read and submit until the work or the time is over; return some states on the way."""
    begin = now = time.monotonic()
    next_submit, samples, n_reads = begin, list[dict[str, Any]](), 0
    while n_done.value < wanted.n_outcomes and (now := time.monotonic()) - begin < wanted.seconds:
        probe.read()
        if now >= next_submit:
            next_submit += SUBMIT_PERIOD_S
            probe.submit()
        share = max(n_done.value / wanted.n_outcomes, (now - begin) / wanted.seconds)
        if share * SAMPLES > len(samples) + 1:
            times = probe.felt.all_reads()
            samples.append(_state(folder, server, n_done.value, times[n_reads:]))
            n_reads = len(times)
        time.sleep(max(0.0, now + READ_PERIOD_S - time.monotonic()))
    return samples


def _state(folder: Path, server: psutil.Process, n_done: int, reads: list[float]) -> dict[str, Any]:
    cpu = server.cpu_times()
    files = [file for file in folder.iterdir() if file.name.startswith("coastarc.db")]
    return {
        "time_s": time.monotonic(),
        "n_outcomes": n_done,
        "memory_mb": server.memory_info().rss / 1e6,
        "cpu_seconds": cpu.user + cpu.system,
        "archive_mb": sum(file.stat().st_size for file in files) / 1e6,
        "read_p99_ms": percentile_ms(reads, 0.99),
    }


def _report(
    folder: Path,
    probe: Probe,
    tally: Tally,
    before: dict[str, Any],
    after: dict[str, Any],
    samples: list[dict[str, Any]],
) -> dict[str, Any]:
    n_outcomes = after["n_outcomes"] - before["n_outcomes"]
    seconds = after["time_s"] - before["time_s"]
    reads = probe.felt.all_reads()
    log = (folder / "server.log").read_text(encoding="utf-8")
    for state in samples:
        state["time_s"] -= before["time_s"]
    return {
        "n_outcomes": n_outcomes,
        "seconds": seconds,
        "outcomes_per_s": n_outcomes / seconds if seconds else 0.0,
        "cpu_ms_per_outcome": 1e3 * (after["cpu_seconds"] - before["cpu_seconds"]) / max(1, n_outcomes),
        "load_cpu_ms_per_outcome": 1e3 * tally.cpu_seconds / max(1, after["n_outcomes"]),
        "reads": {name: _times(times) for name, times in probe.felt.reads.items()},
        "all_reads": _times(reads),
        "submits": _times(probe.felt.submits),
        "claims": _times(tally.claim_s),
        "completions": _times(tally.complete_s),
        "claim_and_completion_p95_ms": _sum(tally.claim_s, tally.complete_s),
        "statuses": dict(sorted(tally.statuses.items())),
        "n_refused_reads": probe.felt.n_refused,
        "n_locked": tally.n_locked + log.count("is locked"),
        "memory_mb": [before["memory_mb"], after["memory_mb"]],
        "memory_mb_per_100_000_outcomes": _memory_slope(samples),
        "archive_mb": after["archive_mb"],
        "samples": samples,
    }


def _memory_slope(samples: list[dict[str, Any]]) -> float | None:
    """Return how much memory grows [MB per 100,000 outcomes], once caches and pools have filled."""
    settled = samples[len(samples) // 2 :]
    if len(settled) < 3:
        return None
    n_outcomes, memory = ([state[name] for state in settled] for name in ("n_outcomes", "memory_mb"))
    return float(1e5 * np.polyfit(n_outcomes, memory, 1)[0])


def _sum(*several: list[float]) -> float | None:
    found = [percentile_ms(times, 0.95) for times in several]
    return sum(one for one in found if one is not None) if all(several) else None


def _times(times: list[float]) -> dict[str, float | None]:
    shares = {"p50_ms": 0.5, "p95_ms": 0.95, "p99_ms": 0.99, "max_ms": 1.0}
    return {"n": len(times)} | {name: percentile_ms(times, share) for name, share in shares.items()}
