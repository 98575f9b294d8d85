"""Facts of a campaign's solves, as stored, from which its statistics are computed.

Statistics never propagate or solve a solution again; docs/method.md, section 9.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from core.problem import Problem

Level = Literal["paper", "strict"]


@dataclass(frozen=True, slots=True)
class SolveFacts:
    """One solve, feasible or not."""

    #: Id of its search, and of the search that its seeds come from.
    search: str
    seeds_from: str | None
    #: "S(k)" or "S(k|k')".
    strategy: str
    k: int
    seed_k: int | None
    #: Tolerance at which a solution of that search could be a seed, "paper" or "strict"; None without seeds.
    seed_level: Level | None
    #: (segment, duration [d]) of each outage of its case.
    outages: tuple[tuple[int, float], ...]
    #: The concrete mapping, None without a seed.
    mapping: str | None
    #: 32 hexadecimal digits, and the hop in that chain: its address in the search.
    chain: str
    hop: int
    #: Name of a `core.nlp.ExitStatus`.
    status: str
    #: At the two tolerances, by the verifier.
    paper: bool
    strict: bool
    cpu_seconds: float
    #: CPU limit of the solve, that of P_0 times 1 + k [s].
    cap_seconds: float
    seed_id: str | None
    #: The solution, None unless feasible to the loose tolerance; delta-v since departure, then with the
    #: spiral.
    solution_id: str | None
    propellant_kg: float | None
    delta_v_km_s: float | None
    delta_v_total_km_s: float | None
    time_of_flight_days: float | None

    @property
    def duration_days(self) -> float | None:
        """The duration that all outages share [d]: 0 without outages, None if they differ."""
        return _shared_duration(self.outages)


@lru_cache(maxsize=4096)  # a campaign has few cases and many solves
def _shared_duration(outages: tuple[tuple[int, float], ...]) -> float | None:
    durations = {duration for _, duration in outages} or {0.0}
    return durations.pop() if len(durations) == 1 else None


@dataclass(frozen=True, slots=True, eq=False)
class CampaignFacts:
    """A campaign, finished or not."""

    id: int
    name: str
    state: str
    rng_seed: int
    #: The reference problem P_0.
    problem: Problem
    #: In the order of the searches, and inside each in order of address (case, chain, hop).
    solves: tuple[SolveFacts, ...]
    #: x by solution id, in the layout of its own P_k; its first 3N + 4 numbers are the reference's.
    vectors: Mapping[str, tuple[float, ...]]
