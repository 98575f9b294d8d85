"""Simulated dispatchers for `coastarc bench service`: they claim over HTTP and answer without solving.

They run in a process of their own, so that their work does not slow down the clocks of the probes.
"""

import http.client
import json
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from functools import cache
from multiprocessing.sharedctypes import Synchronized
from multiprocessing.synchronize import Event
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from workers.job import WorkerInfo

#: How long an idle dispatcher waits before it asks again [s].
IDLE_S = 0.1
HEARTBEAT_S = 10.0
PROVENANCE = {
    "code_version": "0+simulated",
    "python_version": "3",
    "package_versions": {"numpy": "0"},
    "kernel_hashes": {"de440.bsp": "0"},
    "host": "nowhere",
}


@dataclass(frozen=True, slots=True)
class Load:
    """What the workers are told."""

    url: str
    token: str
    info: WorkerInfo
    n_workers: int
    #: Workers of one dispatcher.
    n_slots: int
    #: Outcomes of all workers [1/s]; 0 as fast as they are taken.
    rate_per_s: float
    feasible_share: float


@dataclass(slots=True)
class Tally:
    """What the workers met."""

    statuses: Counter[str] = field(default_factory=Counter)
    claim_s: list[float] = field(default_factory=list)
    complete_s: list[float] = field(default_factory=list)
    n_locked: int = 0
    #: Processor time of their process, which shares the machine with the coordinator.
    cpu_seconds: float = 0.0


class SimulatedDispatcher:
    """A dispatcher with some slots and one connection; its solves only take time."""

    def __init__(
        self, load: Load, number: int, tally: Tally, n_done: "Synchronized[int]", stop: Event
    ) -> None:
        place = urlsplit(load.url)
        self._connection = http.client.HTTPConnection(place.hostname or "", place.port, timeout=120)
        self._headers = {"Authorization": f"Bearer {load.token}", "Content-Type": "application/json"}
        name = f"simulated:{number}"
        self._info = load.info.model_copy(update={"name": name, "slots": load.n_slots}).model_dump()
        self._solve_s = load.n_workers / load.rate_per_s if load.rate_per_s else 0.0
        self._share = load.feasible_share
        self._tally, self._n_done, self._stop = tally, n_done, stop
        self._rng = np.random.default_rng(number)
        now = time.monotonic()
        # When the next solve of each free slot ends; not all in the same moment.
        self._free = [now + self._solve_s * self._rng.random() for _ in range(load.n_slots)]
        self._running: list[tuple[float, dict[str, Any]]] = []
        self._next_heartbeat = now + HEARTBEAT_S

    def run(self) -> None:
        """Work until told to stop; a connection that breaks is opened again."""
        while not self._stop.is_set():
            try:
                self._step()
            except (OSError, http.client.HTTPException) as error:
                self._tally.statuses[type(error).__name__] += 1
                self._connection.close()
                time.sleep(IDLE_S)

    def _step(self) -> None:
        if self._free:
            self._claim()
        if not self._running:
            time.sleep(IDLE_S)
            return
        self._running.sort(key=lambda one: one[0])
        time.sleep(max(0.0, min(self._running[0][0] - time.monotonic(), IDLE_S)))
        now = time.monotonic()
        ended = [one for one in self._running if one[0] <= now]
        if ended:
            del self._running[: len(ended)]
            self._report(ended)
        if now > self._next_heartbeat:
            self._next_heartbeat = now + HEARTBEAT_S
            self._post(
                "heartbeat", {"worker": self._info, "held": [_ticket(c) for _, c in self._running]}, []
            )

    def _claim(self) -> None:
        request = {"worker": self._info, "n_jobs": len(self._free)}
        answer = self._post("claim", request, self._tally.claim_s)
        self._running += [(self._free.pop(), claim) for claim in answer.get("claims", [])]

    def _report(self, ended: list[tuple[float, dict[str, Any]]]) -> None:
        reports = [
            _ticket(claim) | {"outcome": outcome(claim["job"], self._rng, self._share)} for _, claim in ended
        ]
        if len(reports) == 1:
            is_taken = "state" in self._post("complete", reports[0], self._tally.complete_s)
        else:
            is_taken = "answers" in self._post("complete-many", {"reports": reports}, self._tally.complete_s)
        if is_taken:
            with self._n_done.get_lock():
                self._n_done.value += len(reports)
        # The next time follows from the last one, not from now: a slow answer is caught up with.
        self._free += [end + self._solve_s for end, _ in ended]

    def _post(self, verb: str, body: dict[str, Any], times: list[float]) -> dict[str, Any]:
        begin = time.perf_counter()
        self._connection.request("POST", f"/api/v1/jobs/{verb}", _as_json(body), self._headers)
        response = self._connection.getresponse()
        content = response.read()
        times.append(time.perf_counter() - begin)
        self._tally.statuses[f"{verb} {response.status}"] += 1
        self._tally.n_locked += b"is locked" in content
        answer: dict[str, Any] = json.loads(content) if response.status < 400 else {}
        return answer


def _ticket(claim: dict[str, Any]) -> dict[str, Any]:
    return {"job_id": claim["job_id"], "attempt": claim["attempt"]}


def outcome(job: dict[str, Any], rng: np.random.Generator, feasible_share: float) -> dict[str, Any]:
    """Return an outcome as large as a real one: one solve, feasible or not."""
    outages = job["problem"]["outages"]
    k, n_segments = len(outages), job["problem"]["n_segments"]
    is_feasible = bool(rng.random() < feasible_share)
    mass = float(rng.uniform(12_000, 13_000))
    solve = _solve(job, k, is_feasible, mass)
    if is_feasible:
        # A realization has the segments after its outage.
        n_free = sum(n_segments - outage["segment"] for outage in outages)
        solve["x"] = [float(rng.random()), *_rest(4 + 3 * n_segments + 3 * n_free + 4 * k)]
        solve["trajectory"] = _trajectory(mass)
        solve["certificate"] = {
            "paper": True,
            "strict": True,
            "defects": solve["defects"],
            "cpu_seconds": 0.1,
        }
    ending = "feasible" if is_feasible else "infeasible"
    return {"ending": ending, "solves": [solve], "provenance": PROVENANCE}


@cache
def _rest(n: int) -> list[float]:
    """Return all numbers of a vector but the first, which alone makes it another one."""
    numbers: list[float] = np.random.default_rng(n).random(n - 1).tolist()
    return numbers


@cache
def _rest_as_json(n: int) -> str:
    return json.dumps(_rest(n))[1:]


def _as_json(body: dict[str, Any]) -> str:
    """Return a body as text; writing each number of each vector would take most of the generator's time."""
    solves = [one["outcome"]["solves"][0] for one in body.get("reports", [body]) if "outcome" in one]
    vectors = {f"@{n}@": solve.pop("x") for n, solve in enumerate(solves) if "x" in solve}
    for mark, solve in zip(vectors, [s for s in solves if "certificate" in s], strict=True):
        solve["x"] = mark
    text = json.dumps(body)
    for mark, x in vectors.items():
        text = text.replace(f'"{mark}"', f"[{x[0]!r}, {_rest_as_json(len(x))}", 1)
    return text


def _solve(job: dict[str, Any], k: int, is_feasible: bool, mass: float) -> dict[str, Any]:
    place = job["address"]
    return {
        "hop": place["hop"],
        "rng_key": f"{job['rng_seed']}/{place['search']}/{place['case']}/{place['chain']}/{place['hop']}",
        "ending": "feasible" if is_feasible else "infeasible",
        "status": "CONVERGED" if is_feasible else "LOCALLY_INFEASIBLE",
        "is_feasible": is_feasible,
        "objective_kg": mass if is_feasible else None,
        "violation": 0.1 if is_feasible else 1e5,
        "defects": [[1e-3] * 7] * (1 + k),
        "n_iterations": 100,
        "n_evaluations": 150,
        "cpu_seconds": 1.0,
        "wall_seconds": 1.0,
        "move": "accepted" if job["kind"] == "hop" else None,
    }


def _trajectory(mass: float) -> dict[str, Any]:
    return {
        "final_mass_kg": mass,
        "propellant_kg": 13_276.0 - mass,
        "delta_v_km_s": 26.5 * float(np.log(13_276.0 / mass)),
        "delta_v_total_km_s": 26.5 * float(np.log(15_000.0 / mass)),
        "shooting_days": 40.0,
        "initial_coast_days": 1.0,
        "final_coast_days": 2.0,
        "time_of_flight_days": 43.0,
        "insertion_epoch": "2026-06-06T00:00:00.000",
        "arrival_epoch": "2026-06-08T00:00:00.000",
    }


def run_workers(load: Load, n_done: "Synchronized[int]", stop: Event, results: Any) -> None:
    """Run all dispatchers until told to stop, and put their tally into a queue."""
    tally = Tally()
    numbers = range(-(-load.n_workers // load.n_slots))
    threads = [
        threading.Thread(target=SimulatedDispatcher(load, number, tally, n_done, stop).run)
        for number in numbers
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    tally.cpu_seconds = time.process_time()
    results.put(tally)
