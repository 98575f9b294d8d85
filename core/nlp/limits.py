"""How much work a solve may still do: iterations, CPU time, and a caller who may ask it to stop."""

import resource
from collections.abc import Callable
from dataclasses import dataclass, field

Stop = Callable[[], bool]

# RUSAGE_THREAD counts the solving thread alone; only Linux has it.
_WHO = getattr(resource, "RUSAGE_THREAD", resource.RUSAGE_SELF)


def cpu_seconds() -> float:
    """Return the CPU time used so far [s]: an account of work done, not a time of day."""
    usage = resource.getrusage(_WHO)
    return usage.ru_utime + usage.ru_stime


@dataclass(slots=True)
class Limits:
    """The budget of one solve, shared by its phases."""

    cpu_budget: float
    iteration_budget: int
    stop: Stop
    started: float = field(default_factory=cpu_seconds)
    iterations: int = 0
    #: Whether the caller has asked for a stop, once being enough.
    is_stopped: bool = False
    evaluations: int = 0

    @property
    def cpu_used(self) -> float:
        """CPU time since the solve began [s]."""
        return cpu_seconds() - self.started

    @property
    def is_late(self) -> bool:
        """Whether the CPU deadline has passed."""
        return self.cpu_used > self.cpu_budget

    @property
    def is_over(self) -> bool:
        """Whether any limit was reached."""
        self.is_stopped = self.is_stopped or self.stop()
        return self.is_stopped or self.iterations >= self.iteration_budget or self.is_late
