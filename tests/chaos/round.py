"""One round: campaigns under fire, and what is left of them compared with a run that nobody disturbed."""

import sqlite3
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import psutil

from tests.chaos.prober import Prober
from tests.chaos.site import DISPATCHER, POOL_WORKER, RAY_WORKER, Kill, Site, SiteOrder
from tests.chaos.user import User
from tests.chaos.verdict import faults_of, opened, undisturbed
from tests.service.campaigns import OUTAGE, spec_fields

#: How long a first outcome may take, a victim to be there, and everything that is left to be done [s].
START_S, VICTIM_S, FINISH_S = 300.0, 240.0, 900.0
#: What the issue allows: from the loss of a worker, or of an executor, to new work [s].
LOST_WORKER_S, LOST_EXECUTOR_S = 40.0, 90.0
POLL_S = 0.1
#: Deaths that nobody caused, after which a round is given up.
MOST_FAULTS = 5


@dataclass(frozen=True)
class RoundOrder:
    """What is started, what is shot at, and how large its campaigns are."""

    name: str
    site: SiteOrder
    fire: Callable[["Round"], None]
    guesses: int = 60
    #: With a search that chooses among its seeds once its source has ended.
    is_choosing: bool = False


class RoundError(RuntimeError):
    """A round that does not come to its end."""


class Round:
    """Runs an order and knows what happened."""

    def __init__(self, order: RoundOrder, folder: Path, random: Random) -> None:
        self.order = order
        self.random = random
        self.folder = folder
        self.site = Site(folder / "1", order.site)
        self.user = User(self.site, lambda n: campaign_fields(order, n))
        self.prober = Prober(self.site)
        self.n_freezes = 0
        #: From the kill of a part of an executor to the first outcome of a new one [s].
        self.executor_back: list[float] = []
        self.faults: list[str] = []

    def run(self) -> dict[str, Any]:
        """Return what happened, with all that was wrong."""
        begin = time.monotonic()
        with self.site as site, self.prober as prober, self.user as user:
            self.wait_until("a first outcome", self.n_accepted, START_S)
            self.order.fire(self)
            user.submit_no_more()
            self.wait_until("the end of all campaigns", user.is_finished.is_set, FINISH_S)
            prober.stop()
            site.stop()
        undisturbed(self.folder / "undisturbed", list(user.submitted.values()))
        faults = faults_of(site.archive, self.folder / "undisturbed", user.seen_done)
        probes = prober.probes
        faults += self.faults + site.faults + user.faults + [f"probe {fault}" for fault in probes.failures]
        return {
            "round": self.order.name,
            "seconds": round(time.monotonic() - begin, 1),
            "kills": dict(Counter(kill.kind for kill in site.kills)),
            "freezes": self.n_freezes,
            "stale_reports_refused": site.n_stale(),
            "requeues": user.n_requeued,
            "submissions": {"campaigns": len(user.submitted), "tries": user.n_tries, "known": user.n_known},
            "attempts": self.endings(),
            "next_attempt_s": {kind: spread(found) for kind, found in self.next_attempts().items()},
            "executor_back_s": rounded(self.executor_back),
            "coordinator_back_s": spread(probes.absences),
            "probes": spread(probes.seconds) | {"excused": probes.n_excused, "failed": len(probes.failures)},
            "faults": faults,
        }

    def wait(self, seconds: float) -> None:
        """Let work go on for so long."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.site.keep_alive()
            time.sleep(min(left, POLL_S))

    def wait_until(self, what: str, condition: Callable[[], Any], seconds: float) -> Any:
        """Return what a condition says once it is true; one that does not come true is a fault."""
        end = time.monotonic() + seconds
        while not (found := condition()):
            is_hopeless = self.user.faults or len(self.site.faults) > MOST_FAULTS
            if time.monotonic() > end or is_hopeless:
                said = self.site.last_words("coordinator")
                self.faults.append(
                    f"round: expected {what} in {seconds:.0f} s, got none; the coordinator said {said}"
                )
                raise RoundError(self.faults + self.user.faults + self.site.faults)
            self.wait(POLL_S)
        return found

    def require(self, what: str, seconds: float, most: float) -> None:
        """Note what took longer than it may."""
        if seconds > most:
            self.faults.append(f"expected {what} in {most:g} s, got {seconds:.1f} s")

    def kill(self, kind: str) -> Kill:
        """Kill one of a kind, as soon as there is one."""
        while True:
            found = self.wait_until(f"a {kind}", lambda: self.site.victims(kind), VICTIM_S)
            try:
                return self.site.kill(kind, self.random.choice(found))
            except psutil.NoSuchProcess:
                # It ended by itself in the meantime, as orphans do.
                continue

    def freeze(self) -> None:
        """Stop the dispatcher elsewhere, while it holds a job, for longer than its lease."""
        held = "SELECT 1 FROM attempt WHERE ended_at IS NULL AND worker LIKE ?"
        self.wait_until(
            "a job held by the dispatcher elsewhere",
            lambda: self.rows(held, (f"%:{self.site.remote_pid}:%",)),
            VICTIM_S,
        )
        self.site.freeze(1.0 + self.order.site.lease_s)
        self.n_freezes += 1

    def n_accepted(self) -> int:
        """Return how many outcomes the archive holds."""
        return len(self.rows("SELECT 1 FROM attempt WHERE next_state = 'done'"))

    def endings(self) -> dict[str, int]:
        """Return how many attempts ended in each way."""
        return dict(self.rows("SELECT ending, count(*) FROM attempt GROUP BY ending ORDER BY ending"))

    def next_attempts(self) -> dict[str, list[float]]:
        """Return by kind of victim how long after their kill its jobs began to run again [s]."""
        found: dict[str, list[float]] = {}
        query = (
            "SELECT n.started_at - :at FROM attempt a JOIN attempt n"
            " ON n.job_id = a.job_id AND n.attempt = a.attempt + 1"
            " WHERE a.worker LIKE :worker AND a.ending = :ending AND a.started_at <= :at"
            " AND a.ended_at >= :at AND a.ended_at < :at + :most"
        )
        for kill in self.site.kills:
            if kill.kind not in (DISPATCHER, POOL_WORKER, RAY_WORKER):
                continue
            # A dispatcher takes all its jobs along; what else dies is noticed, and reported, within moments.
            ending, most = ("lost", 1e9) if kill.kind == DISPATCHER else ("crash", 3.0)
            wanted = {"at": kill.at, "worker": f"%:{kill.dispatcher}:%", "ending": ending, "most": most}
            found.setdefault(kill.kind, []).extend(row[0] for row in self.rows(query, wanted))
        return found

    def has_taken_jobs(self, kill: Kill) -> bool:
        """Return whether somebody had jobs when it was killed, a while after that."""
        query = (
            "SELECT 1 FROM attempt WHERE worker LIKE ? AND started_at <= ?"
            " AND (ended_at IS NULL OR ending = 'crash')"
        )
        return bool(self.rows(query, (f"%:{kill.dispatcher}:%", kill.at)))

    def first_outcome_elsewhere(self, kill: Kill) -> float | None:
        """Return when an executor that was started after a kill handed in its first outcome, if it has."""
        query = (
            "SELECT min(ended_at) FROM attempt JOIN worker ON worker.name = attempt.worker"
            " WHERE executor = 'ray' AND next_state = 'done' AND started_at > ? AND worker NOT LIKE ?"
        )
        found = self.rows(query, (kill.at, f"%:{kill.dispatcher}:%"))
        return found[0][0] if found else None

    def rows(self, query: str, values: Any = ()) -> list[Any]:
        """Return what the archive of the service says, or nothing while it is made or recovered."""
        try:
            with closing(opened(self.site.archive)) as archive:
                return archive.execute(query, values).fetchall()
        except sqlite3.OperationalError:
            return []


def campaign_fields(order: RoundOrder, number: int) -> dict[str, Any]:
    """Return S(0), and the seed chains S(1|0), S(2|1) and S(3|2) that feed on it."""
    outages = [OUTAGE, {"segment": 40, "duration_days": 1.0}, {"segment": 12, "duration_days": 1.0}]
    name = f"{order.name} {number}".replace(" ", "-")
    fields = spec_fields(order.guesses, campaign={"name": name, "rng_seed": 1000 + number})
    fields["search"] += [
        {
            "id": f"s{k}-{k - 1}",
            "strategy": f"S({k}|{k - 1})",
            "outages": outages[:k],
            "seeds": {"from": source},
        }
        for k, source in ((2, "s1-0"), (3, "s2-1"))
    ]
    if order.is_choosing:
        seeds = {"from": "s0", "order": "delta_v", "limit": 6}
        fields["search"] += [{"id": "best", "strategy": "S(1|0)", "outages": outages[2:], "seeds": seeds}]
    return fields


def spread(seconds: Sequence[float]) -> dict[str, Any]:
    """Return number, median, 99th percentile and greatest of some times [s]."""
    if not seconds:
        return {"n": 0}
    ordered = sorted(seconds)
    places = {"median": 0.5, "p99": 0.99, "worst": 1.0}
    n = len(ordered)
    return {"n": n} | {key: round(ordered[min(n - 1, int(share * n))], 3) for key, share in places.items()}


def rounded(seconds: Sequence[float]) -> list[float]:
    return [round(value, 2) for value in seconds]
