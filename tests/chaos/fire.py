"""Who is killed, and when: drawn from a generator whose rng_seed is printed."""

from collections.abc import Sequence
from dataclasses import dataclass

from tests.chaos.round import LOST_EXECUTOR_S, LOST_WORKER_S, Round
from tests.chaos.site import DISPATCHER, POOL_WORKER, Kill

#: Longer than any bound, so that what takes too long is measured all the same [s].
PATIENCE_S = 240.0
#: After which a job that is still open, and was before, has lost its worker [s].
LONG_ENOUGH_S = 2.0


@dataclass(frozen=True)
class AtRandom:
    """Kills some of each kind, in any order, after waits drawn between two bounds [s]."""

    n_kills: dict[str, int]
    gap_s: tuple[float, float]
    #: How often the dispatcher elsewhere is frozen for longer than its leases.
    n_freezes: int = 0
    #: Share of the waits that begin when the coordinator answers; the others may end while it starts.
    settled_share: float = 0.5

    def __call__(self, under_fire: Round) -> None:
        """Kill."""
        random = under_fire.random
        acts: list[str | None] = [kind for kind, n in self.n_kills.items() for _ in range(n)]
        acts += [None] * self.n_freezes
        random.shuffle(acts)
        for kind in acts:
            if random.random() < self.settled_share:
                under_fire.wait_until("an answer", under_fire.prober.is_answered, PATIENCE_S)
            under_fire.wait(random.uniform(*self.gap_s))
            if kind is not None:
                under_fire.kill(kind)
            else:
                under_fire.freeze()


@dataclass(frozen=True)
class UntilItIsBack:
    """Kills what an executor cannot do without, and waits for the first outcome of the next one."""

    kind: str
    n_kills: int
    gap_s: tuple[float, float]

    def __call__(self, under_fire: Round) -> None:
        """Kill, and measure."""
        for _ in range(self.n_kills):
            under_fire.wait(under_fire.random.uniform(*self.gap_s))
            kill = under_fire.kill(self.kind)
            back = self._back(under_fire, kill) - kill.at
            under_fire.executor_back.append(back)
            under_fire.require(f"the executor back after a {self.kind} was killed", back, LOST_EXECUTOR_S)

    def _back(self, under_fire: Round, kill: Kill) -> float:
        return under_fire.wait_until(
            "an outcome of a new executor", lambda: under_fire.first_outcome_elsewhere(kill), PATIENCE_S
        )


@dataclass(frozen=True)
class OneOfEach:
    """Kills workers that hold jobs, one by one, and waits until their jobs run again."""

    kinds: Sequence[str] = (DISPATCHER, POOL_WORKER)

    def __call__(self, under_fire: Round) -> None:
        """Kill until each kind has taken a job along, and measure."""
        for kind in self.kinds:
            while not self._takes_a_job_along(under_fire, kind):
                continue
            found = self._next_attempts(under_fire, kind)
            under_fire.require(f"the jobs of a killed {kind} to run again", max(found), LOST_WORKER_S)

    def _takes_a_job_along(self, under_fire: Round, kind: str) -> bool:
        kill = under_fire.kill(kind)
        under_fire.wait(LONG_ENOUGH_S)
        return under_fire.has_taken_jobs(kill)

    def _next_attempts(self, under_fire: Round, kind: str) -> list[float]:
        return under_fire.wait_until(
            f"the next attempt at the job of a killed {kind}",
            lambda: under_fire.next_attempts().get(kind),
            PATIENCE_S,
        )
