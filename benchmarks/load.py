"""Simulated dispatchers for `benchmarks.service`: they claim over HTTP and answer without solving.

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

from core.constants import SECONDS_PER_DAY
from core.epochs import calendar_epoch
from core.problem import Problem, problem_from
from service.validation import facts_of, figures
from workers.messages import KIND_NUMBERS, WorkerInfo

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
        self._connection.request("POST", f"/api/v1/jobs/{verb}", as_json(body), self._headers)
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
    """Return an outcome as large as a real one; vectors are JSON already, see `as_json`."""
    made = _made_for(json.dumps(job["problem"]))
    solves = []
    for number in range(job.get("n_hops", 1)):
        is_feasible = bool(rng.random() < feasible_share)
        solve = _solve(job, job["address"]["hop"] + number, made.problem.k, is_feasible)
        solves.append(solve | made.found(rng, solve["defects"]) if is_feasible else solve)
    ending = "feasible" if any("x" in solve for solve in solves) else "infeasible"
    return {"ending": ending, "solves": solves, "provenance": PROVENANCE}


class _MadeUp:
    """Solutions of one problem, each with another shooting time and final mass; nobody has flown them."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.facts = problem, facts_of(problem)
        lower, upper = self.facts.bounds
        self.x = lower + 0.5 * (upper - lower)
        own = self.facts.layout.reference
        self.ranges = [(lower[i], upper[i]) for i in (own.shooting_time, own.final_mass)]
        #: What stands in every vector between and behind these two, as JSON.
        between, behind = self.x[1 : own.final_mass], self.x[own.stop :]
        self.texts = [", ".join(map(repr, part.tolist())) for part in (between, behind)]

    def found(self, rng: np.random.Generator, defects: list[list[float]]) -> dict[str, Any]:
        own, x = self.facts.layout.reference, self.x.copy()
        (shortest, longest), (_, most) = self.ranges
        x[own.shooting_time] = rng.uniform(shortest, longest)
        x[own.final_mass] = mass = float(rng.uniform(0.9 * most, most))
        said = figures(self.facts, x)
        arrival = self.facts.start_et + said["time_of_flight_days"] * SECONDS_PER_DAY
        epochs = (arrival - said["final_coast_days"] * SECONDS_PER_DAY, arrival)
        said["final_mass_kg"] = said.pop("objective_kg")
        named = zip(("insertion_epoch", "arrival_epoch"), map(calendar_epoch, epochs), strict=True)
        verdict = {"paper": True, "strict": True, "defects": defects, "cpu_seconds": 0.1}
        found = {"objective_kg": mass, "trajectory": said | dict(named), "certificate": verdict}
        between, behind = self.texts
        # Writing each number of each vector would take most of the generator's time.
        text = f"[{float(x[0])!r}, {between}, {mass!r}{', ' * bool(behind)}{behind}]"
        return found | {"x": text}


@cache
def _made_for(definition: str) -> _MadeUp:
    return _MadeUp(problem_from(json.loads(definition)))


def as_json(body: dict[str, Any]) -> str:
    """Return a body as JSON, into which vectors go as the text that they are already."""
    reports = [one for one in body.get("reports", [body]) if "outcome" in one]
    solves = [solve for one in reports for solve in one["outcome"]["solves"]]
    vectors = []
    for solve in solves:
        if "x" in solve:
            vectors.append(solve["x"])
            solve["x"] = f"@{len(vectors)}@"
    text = json.dumps(body)
    for number, vector in enumerate(vectors, 1):
        text = text.replace(f'"@{number}@"', vector, 1)
    return text


def _solve(job: dict[str, Any], hop: int, k: int, is_feasible: bool) -> dict[str, Any]:
    place = job["address"]
    address = (KIND_NUMBERS[job["kind"]], *(place[name] for name in ("search", "case", "chain")), hop)
    return {
        "hop": hop,
        "rng_key": "/".join(map(str, (job["rng_seed"], *address))),
        "ending": "feasible" if is_feasible else "infeasible",
        "status": "OPTIMAL" if is_feasible else "LOCALLY_INFEASIBLE",
        "is_feasible": is_feasible,
        "objective_kg": None,
        "violation": 0.1 if is_feasible else 1e5,
        "defects": [[1e-6] * 7] * (1 + k),
        "n_iterations": 100,
        "n_evaluations": 150,
        "cpu_seconds": 1.0,
        "wall_seconds": 1.0,
        "move": "accepted" if job["kind"] == "hop" else None,
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
