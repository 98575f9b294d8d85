"""How long a worker may keep a job unasked, and how long a job that failed waits for its next attempt."""

from dataclasses import dataclass

#: Wait after the first failure and at most; it doubles in between [s].
BACKOFF_S = 1.0
LONGEST_BACKOFF_S = 60.0


@dataclass(frozen=True, slots=True)
class LeaseSettings:
    """The clockwork of leases [s]: a lease outlives two heartbeats that got lost."""

    lease_s: float = 30.0
    heartbeat_s: float = 10.0
    #: How often expired leases are looked for.
    reap_s: float = 5.0

    def __post_init__(self) -> None:
        """Refuse a clockwork that would take jobs from workers that are well."""
        if not 0 < self.heartbeat_s < self.lease_s or not self.reap_s > 0:
            raise ValueError(
                f"leases: expected 0 < heartbeat_s < lease_s and 0 < reap_s, got heartbeat_s = "
                f"{self.heartbeat_s}, lease_s = {self.lease_s}, reap_s = {self.reap_s}"
            )


def backoff_s(n_failures: int) -> float:
    """Return how long a job waits after so many failures [s]."""
    # Bounded before the power, which would overflow for a job that somebody requeues for ever.
    return min(BACKOFF_S * 2.0 ** min(n_failures - 1, 30), LONGEST_BACKOFF_S) if n_failures else 0.0
